"""The simulated world except SUMO: members, obstacles, sensing, contacts, orders, breakdowns, kinds of events."""
