"""Worker processes that grade, one submission at a time each; one that dies costs its submission one retry."""

import ctypes
import multiprocessing
import os
import signal
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import cast

from dualnav_lite.config import UnusableInput
from grading.intake import Submission
from grading.room import Room
from grading.store import write_result, write_whole
from grading.submission import grade_timed

PARENT_DEATH = 1  # PR_SET_PDEATHSIG
MOST_A_WORKER = 20  # submissions; then a fresh one takes over, so that memory stays flat however large a class is


def _work(pipe, room: Room, parent: int) -> None:
    """A worker process: grades what it is sent, one at a time; ends with its parent."""
    ctypes.CDLL(None).prctl(PARENT_DEATH, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent gets it too and ends us
    while (task := pipe.recv()) is not None:
        submission, path = task
        result, times = grade_timed(room, submission)
        if result is None:
            pipe.send("ungraded")
            continue
        try:
            write_result(path, result, times)
        except UnusableInput as refusal:
            pipe.send(refusal)
            continue
        pipe.send("done")


def run_workers(room: Room, todo: list[tuple[Submission, Path]], jobs: int, say) -> int:
    """Grade a list with some workers; how many stayed ungraded. A worker that dies costs its submission one retry.

    Raises:
        UnusableInput: a result cannot be written, so none of the others could be kept either.
    """
    context = multiprocessing.get_context("fork")
    waiting, lost, done = list(todo), 0, 0
    again: list[tuple[Submission, Path]] = []
    busy: dict = {}
    idle: list = []
    served: dict = {}

    def hire():
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, room, os.getpid()), daemon=True)
        process.start()
        theirs.close()
        return ours, process

    try:
        while waiting or busy or again:
            if not waiting and not busy:
                waiting, again = again, []
            while waiting and len(busy) < jobs:
                pipe, process = idle.pop() if idle else hire()
                task = waiting.pop(0)
                mark = task[1].with_suffix(".attempt")
                second = mark.exists()
                write_whole(mark, b"")
                pipe.send(task)
                busy[pipe] = process, task, second
            for pipe in cast(list[Connection], wait(list(busy))):
                process, task, second = busy.pop(pipe)
                try:
                    answer = pipe.recv()
                    served[pipe] = served.get(pipe, 0) + 1
                    if served[pipe] < MOST_A_WORKER:
                        idle.append((pipe, process))
                    else:
                        pipe.send(None)
                        process.join()
                        pipe.close()
                except (EOFError, OSError):
                    process.join()
                    answer = "died"
                if isinstance(answer, UnusableInput):
                    raise answer
                if answer == "died" and not second:
                    again.append(task)
                    continue
                done += answer == "done"
                lost += answer != "done"
                if answer == "done":
                    task[1].with_suffix(".attempt").unlink(missing_ok=True)
                say(f"{done + lost} of {len(todo)} submissions")
    finally:
        for pipe, process in [*idle, *((pipe, one[0]) for pipe, one in busy.items())]:
            process.kill()
            process.join()
            pipe.close()
    return lost
