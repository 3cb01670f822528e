"""Meaning of the values of maps: layers, frames, arrival times and places."""
