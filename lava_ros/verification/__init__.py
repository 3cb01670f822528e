"""Exact solutions and the cases that hold the solver against them."""
