"""The road network and its files, routes on it, and gap acceptance at junctions."""
