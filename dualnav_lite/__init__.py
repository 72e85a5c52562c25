"""dualnav-lite: a teaching kit for robot navigation by reinforcement learning, safe and thrifty at once."""

import gymnasium

__version__ = "0.1.0"

gymnasium.register(
    id="DualNav-v0",
    entry_point="dualnav_lite.env:DynamicNavEnv",
    vector_entry_point="dualnav_lite.env:DynamicNavVectorEnv",
)
