"""The exercises of lesson 07: terms of the reward and their weights."""

import numpy as np

from .arrays import each, numbers, theirs


def safe(names, given, kept):
    function = theirs(names, "safe")
    if "one_by_one" in given:
        return {"values": each(function, given["one_by_one"])}
    return {"values": numbers(function(given["clearance"].copy()))}


def goal(names, given, kept):
    function, gamma = theirs(names, "goal"), given["gamma"].item()
    before, after, reached = (given[name].copy() for name in ("before", "after", "reached"))
    if "one_by_one" in given:
        return {"values": each(lambda b, a, r: function(b, a, r, gamma), before, after, reached)}
    return {"values": numbers(function(before, after, reached, gamma))}


def reward_terms(names, given, kept):
    from dualnav_lite.rewards import Transition

    rows = []
    for k in range(len(given["clearance"])):
        fields = {name: value[k].item() if value[k].ndim == 0 else value[k].copy() for name, value in given.items()}
        terms = theirs(names, "reward_terms")(Transition(**fields))
        rows.append([float(terms[name]) for name in ("safe", "dynamic", "energy", "goal", "terminal")])
        if len(terms) != 5:
            raise KeyError("terms")
    return {"values": np.array(rows)}


def reward_weights(names, given, kept):
    rows = [
        theirs(names, "reward_weights")(p.item(), b.item())
        for p, b in zip(given["preference"], given["charge"], strict=True)
    ]
    return {"values": numbers(np.stack([numbers(row) for row in rows]))}
