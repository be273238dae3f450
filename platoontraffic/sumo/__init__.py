"""Everything that talks to SUMO."""
