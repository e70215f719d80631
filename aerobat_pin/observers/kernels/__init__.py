"""What the streaming and the batch call of an observer compute, compiled."""
