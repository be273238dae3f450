"""What is in the simulated world beside SUMO's own: members, obstacles, their sensing and contacts."""
