"""A trained policy judged in the scorer's own worlds: observations go into the sandbox, commands come out."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic

import numpy as np

from dualnav_lite.chunks import Chunk
from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.episodes import OUTCOMES
from dualnav_lite.evaluate import library_env, run_episodes
from dualnav_lite.scenario import load_scenario
from grading import wire
from grading.lesson import MOST_REPLY, Outcome, Setting, cut_off, error_reason
from grading.rubric import Policy
from grading.sandbox import Job, Sandbox, SandboxError
from grading.tasks import hypervolume, survival

PREFERENCE = 0.5  # of the survival runs, the default
WORLDS = 20  # side by side
MOST_COMMAND = 10.0  # [m/s], [rad/s]: the environment clips what is a little too much, this is no command at all


class PolicyEnded(UnusableInput):
    """The policy's side is of no more use; nobody's episode, so the whole evaluation ends."""

    def __init__(self, outcome: Outcome):
        super().__init__(outcome.reason)
        self.outcome = outcome


class RemotePolicy:
    """A planner whose commands come from a sandbox.

    Args:
        caller: of the sandbox.
        seconds: that it may think altogether.
        killed_for: what the watchdog killed the sandbox for, if it did.
    """

    needs_truth = False
    needs_full_map = False

    def __init__(self, caller, seconds: float, killed_for: Callable[[], str] = lambda: ""):
        self._caller, self._left, self._killed_for = caller, seconds, killed_for
        self._fresh: set[int] = set()

    def reset(self, indices) -> None:
        """These worlds begin anew; it is told with their next observations."""
        self._fresh.update(int(i) for i in np.atleast_1d(indices))

    def act(self, observations, infos) -> np.ndarray:
        """(n, 2) commands; zero where no goal is open.

        Raises:
            PolicyEnded: no answer, or one that is none.
        """
        asked = np.flatnonzero([not info.get("idle", False) for info in infos])
        commands = np.zeros((len(observations), 2))
        if not len(asked):
            return commands
        arrays = {
            "observations": np.asarray(observations[asked], np.float32),
            "worlds": asked.astype(np.int64),
            "fresh": np.array([int(i) in self._fresh for i in asked]),
        }
        self._fresh -= set(asked.tolist())
        start = monotonic()
        try:
            error, answer = self._caller.ask("policy", arrays, self._left)
        except wire.ProtocolError as problem:
            raise PolicyEnded(Outcome(0.0, *cut_off(problem, self._killed_for()))) from None
        self._left -= monotonic() - start
        reason = error_reason(error) if error else command_problem(answer, len(asked))
        if reason:
            raise PolicyEnded(Outcome(0.0, "error" if error else "failed", reason))
        commands[asked] = answer["actions"]
        return commands


def command_problem(answer: dict[str, np.ndarray], count: int) -> str:
    """Empty where an answer holds a command for each world, else a reason code."""
    if set(answer) != {"actions"} or answer["actions"].dtype.kind != "f":
        return "wrong_type"
    if answer["actions"].shape != (count, 2):
        return "wrong_shape"
    if not np.isfinite(answer["actions"]).all():
        return "not_finite"
    return "command_out_of_range" if np.abs(answer["actions"]).max() > MOST_COMMAND else ""


@dataclass
class Drives:
    """Episodes of one policy, run when they are first asked for.

    Args:
        planner: who drives.
        seeds_of: (scenario, count) to hidden seeds; more of them begin with the same ones.
    """

    planner: RemotePolicy
    seeds_of: Callable[[str, int], list[int]]
    kept: dict[tuple[str, float], list[dict]] = field(default_factory=dict)

    def rows(self, scenario: str, preference: float, count: int) -> list[dict]:
        """Rows of the first `count` seeds."""
        known = self.kept.setdefault((scenario, preference), [])
        seeds = self.seeds_of(scenario, count)[len(known) :]
        if seeds:
            chunk = Chunk(load_scenario(scenario), "policy", tuple(seeds), Path())
            config = with_overrides(Config(), {"preference": preference})
            known += run_episodes(chunk, seeds, config, WORLDS, lambda *_: self.planner, library_env)
        return known[:count]


def judge_survival(drives: Drives, policy: Policy) -> tuple[Outcome, list[dict]]:
    """Outcome of `survival`, and a line a scenario for `survival.csv`."""
    table = []
    for scenario, threshold in policy.survival.thresholds.items():
        rule = policy.survival.of(scenario)
        for count in survival.looks(rule):
            rows = drives.rows(scenario, PREFERENCE, count)
            kinds = [OUTCOMES[row["outcome"]] for row in rows]
            survived = kinds.count("survived")
            decision = survival.decide(survived, count, threshold, rule)
            if decision != survival.UNDECIDED:
                break
        low, high = survival.interval(survived, count, rule)
        line = {"scenario": scenario, "episodes": count, "survived": survived, "threshold": threshold}
        line |= {"low": round(low, 4), "high": round(high, 4), "decision": decision}
        line |= {f"{kind}s": kinds.count(kind) for kind in ("collision", "timeout", "error")}
        table.append(line | {"flat_batteries": kinds.count("flat_battery")})
    passed = sum(line["decision"] == survival.PASSED for line in table)
    status = "passed" if passed == len(table) else "partial" if passed else "failed"
    reason = "" if status == "passed" else "survives_too_rarely"
    detail = {"right": passed, "asked": len(table), "survival": table}
    return Outcome(passed / len(table), status, reason, "policy:student", detail), table


def judge_hypervolume(drives: Drives, policy: Policy, table: list[dict]) -> Outcome:
    """Outcome of `hypervolume`; its detail holds a point a preference. Who fails the scenario need not drive on."""
    rule = policy.hypervolume
    if any(line["scenario"] == rule.scenario and line["decision"] == survival.FAILED for line in table):
        return Outcome(0.0, "failed", "survives_too_rarely", "policy:student")
    found = [(p, *hypervolume.point(drives.rows(rule.scenario, p, rule.seeds))) for p in rule.preferences]
    share = hypervolume.share([(safe, energy) for _, safe, energy in found], rule)
    points = [
        {
            "scenario": rule.scenario,
            "preference": p,
            "episodes": rule.seeds,
            "safe_dist_m": round(safe, 4),
            "energy_j_per_goal": round(energy, 2) if np.isfinite(energy) else None,
        }
        for p, safe, energy in found
    ]
    passed = share >= rule.threshold
    detail = {"share_of_box": round(share, 4), "threshold": rule.threshold, "pareto": points}
    reason = "" if passed else "dominates_too_little"
    return Outcome(float(passed), "passed" if passed else "failed", reason, "policy:student", detail)


def grade_policy(setting: Setting, policy: Policy, weights: bytes) -> dict[str, Outcome]:
    """Outcome of each part of the policy task; what ends the sandbox costs the parts that were not judged before."""
    outcomes: dict[str, Outcome] = {}

    def all_else(outcome: Outcome) -> dict[str, Outcome]:
        return dict.fromkeys(policy.points(), outcome) | outcomes

    try:
        # No kernels: nothing compiled runs in there, and copying them takes a tenth of a second.
        job = Job(setting.packages, {"weights": weights}, program="serve.py", limits=setting.limits)
        with Sandbox(job, setting.tier) as sandbox:
            connection, _ = sandbox.accept(setting.limits.start_s, MOST_REPLY)
            planner = RemotePolicy(wire.Caller(connection), policy.seconds, lambda: sandbox.killed_for)
            drives = Drives(planner, setting.secret.seeds)
            outcomes["survival"], table = judge_survival(drives, policy)
            if policy.hypervolume:
                outcomes["hypervolume"] = judge_hypervolume(drives, policy, table)
            return outcomes
    except PolicyEnded as end:
        return all_else(end.outcome)
    except (SandboxError, wire.ProtocolError):  # before the first question no byte of the student's was read
        return all_else(Outcome(0.0, "ungraded", "sandbox_failed"))
