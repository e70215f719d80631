"""Analysis of estimates: bias, noise, lag, time of an event, and the place where a force acts."""
