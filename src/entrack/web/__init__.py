"""A web page: draw a box, watch it tracked, correct it, take the result home. Extra `web`."""
