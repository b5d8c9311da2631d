"""Text: figures as people read them, and markup that is safe by construction."""
