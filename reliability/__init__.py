"""What entrack survives: programs that measure it, a line of figures and a JSON file each."""
