"""What is flown: the paper's experiments and ours, their scenes, noise and approaches."""
