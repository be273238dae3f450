"""Environments in which members of a platoon learn, for Gymnasium and PettingZoo (extra `learn`).

Importing it registers "platoontraffic/Follower-v0". In any process,
`gymnasium.make("platoontraffic.environments:platoontraffic/Follower-v0")` does both.
"""

from gymnasium.envs.registration import register

register("platoontraffic/Follower-v0", entry_point="platoontraffic.environments.follower:Follower")
