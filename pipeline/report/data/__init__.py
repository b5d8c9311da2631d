"""What the figures draw from: who takes part, and who saw what when."""
