"""One flight: drawn, solved by every approach, measured against the truth and held against the bound."""
