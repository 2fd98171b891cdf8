"""Scores under named protocols, and the runs that produce what is scored."""
