"""What the formats share: numbers and places as text, tables and XML written and read with care."""
