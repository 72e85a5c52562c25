"""Submissions graded by the workers of a Dask cluster; what they send back is kept here, as if graded here.

A worker makes its own masked copy of the library and its own self-check, since its machine has a sandbox of its own.
Whoever can give a worker tasks can run code on it, so an address is loopback or TLS; workers get the key's seeds.
"""

import atexit
import contextlib
from pathlib import Path

import joblib

from dualnav_lite.config import UnusableInput
from dualnav_lite.workers import pool
from grading.intake import Submission
from grading.job import Limits
from grading.room import Room, prepared
from grading.rubric import Rubric
from grading.secret import Secret
from grading.self_check import self_check
from grading.store import write_result
from grading.submission import grade_timed

_ROOMS: dict[str, Room] = {}  # of this worker process, by fingerprint
_OPEN = contextlib.ExitStack()


def _room(rubric: Rubric, secret: Secret, tier: str, limits: Limits, fingerprint: str) -> Room:
    """This worker's room, made and checked the first time.

    Raises:
        UnusableInput: the worker's kit is another one, or its sandbox does not deny what it must.
    """
    if fingerprint not in _ROOMS:
        room = _OPEN.enter_context(prepared(rubric, secret, tier, limits))
        if room.fingerprint() != fingerprint:
            raise UnusableInput("a worker of the cluster has another version of the kit; install the same one there")
        self_check(room)
        if not _ROOMS:
            atexit.register(_OPEN.close)
        _ROOMS[fingerprint] = room
    return _ROOMS[fingerprint]


def grade_there(rubric: Rubric, secret: Secret, tier: str, limits: Limits, fingerprint: str, task: tuple) -> tuple:
    """Path, result and times of one submission; the result is None where it stayed ungraded. Runs on a worker."""
    submission, path = task
    try:
        return path, *grade_timed(_room(rubric, secret, tier, limits, fingerprint), submission)
    except UnusableInput as error:
        return path, None, str(error)
    except Exception as error:  # this one stays ungraded; raised here it would end the others' grading
        return path, None, f"grading raised {type(error).__name__}"


def run_on_cluster(room: Room, todo: list[tuple[Submission, Path]], cluster: str, say) -> int:
    """Grade a list on a cluster; how many stayed ungraded. Results are written as they come, in any order.

    Raises:
        UnusableInput: an address that will not do, nobody answers there, no worker can grade, or a result cannot be
            written.
    """
    given = (room.rubric, room.secret, room.tier, room.limits, room.fingerprint())
    done, problem = 0, ""
    with pool(cluster=cluster) as parallel:
        answers = parallel(joblib.delayed(grade_there)(*given, (one.packed(), path)) for one, path in todo)
        try:
            for path, result, times in answers:
                if result is None:
                    problem = problem or (times if isinstance(times, str) else "")
                    continue
                write_result(path, result, times)
                done += 1
                say(f"{done} of {len(todo)} submissions")
        except UnusableInput:  # a full disk is ours
            raise
        except (
            Exception
        ) as error:  # Dask's own: workers that died under the same submission three times, or all of them
            say(f"the cluster gave up ({type(error).__name__}); what came back is kept")
    if problem and not done:
        raise UnusableInput(f"nothing is graded: {problem}")
    return len(todo) - done
