"""The stages as commands run them: what is finished, what is written, workers, results."""
