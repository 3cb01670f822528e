"""The `lava` command line."""
