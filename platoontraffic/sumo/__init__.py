"""The coupling with SUMO: processes, conversions, members and background traffic in it."""
