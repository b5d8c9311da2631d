"""One module for each view of the page: it takes the results and answers with a section or a figure."""
