"""What is done, what is missing and why; nothing here computes."""
