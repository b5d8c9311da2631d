"""Where every camera was, as measured: from its log, a table, or standing still."""
