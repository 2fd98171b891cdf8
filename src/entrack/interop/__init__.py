"""The tracker in the shapes that other libraries and toolkits expect; each imports only its own."""
