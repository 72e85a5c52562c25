"""Plain arrays to a student's arguments and back, inside the sandbox; one adapter an exercise.

An adapter gets (names of the notebook, arrays of the call, what is kept between calls) and gives arrays. Inside, this
folder is a package of its own beside `serve.py`, so its files name each other relatively and nothing else of `grading`.
"""

from .encoder import encode_state, paint_bands, project_intensity
from .environment import closed_loop
from .policy import policy
from .ppo import gae, learning, policy_loss, update, value_loss
from .rewards import goal, reward_terms, reward_weights, safe

ADAPTERS = {
    "safe": safe,
    "goal": goal,
    "reward_terms": reward_terms,
    "reward_weights": reward_weights,
    "gae": gae,
    "paint_bands": paint_bands,
    "project_intensity": project_intensity,
    "encode_state": encode_state,
    "closed_loop": closed_loop,
    "policy_loss": policy_loss,
    "value_loss": value_loss,
    "update": update,
    "learning": learning,
    "policy": policy,
}
