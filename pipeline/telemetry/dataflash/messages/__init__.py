"""DataFlash bytes or text become tables: messages by the log's own definitions, damage stepped over."""
