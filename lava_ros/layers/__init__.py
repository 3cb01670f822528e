"""What the numbers of maps mean: layers, frames, arrival times and places."""
