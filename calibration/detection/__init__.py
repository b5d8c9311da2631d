"""The board found in a photo, and its corners to a hundredth of a pixel."""
