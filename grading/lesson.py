"""One lesson of one submission: sandboxes started, questions asked, outcomes."""

import builtins
import contextlib
import time
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from grading import wire
from grading.job import Job, Limits, SandboxError
from grading.rebuild import Master, names_of, normalised, rebuilt
from grading.rubric import Lesson
from grading.said import said_by
from grading.sandbox import Sandbox
from grading.secret import Secret
from grading.tasks import Marks, task_of

MOST_REPLY = 8 << 20
# Names of exceptions that may be shown: a student chooses the name of his own, so no other name is.
KNOWN_ERRORS = frozenset(
    name for name, value in vars(builtins).items() if isinstance(value, type) and issubclass(value, Exception)
)


@dataclass
class Outcome:
    """What an exercise got.

    Attributes:
        share: of its points, in [0, 1].
        status: passed, partial, failed, error, timeout, not_run or ungraded.
        reason: code; empty where passed.
        source: whose parts were run, such as `gae:student`, joined by `+`.
        detail: numbers for feedback that tell nothing hidden: questions right and asked, reason codes in order.
    """

    share: float
    status: str
    reason: str = ""
    source: str = ""
    detail: dict = field(default_factory=dict)


@dataclass
class Setting:
    """What a lesson is graded with.

    Attributes:
        master: teacher's notebook.
        lesson: of the rubric.
        packages: masked copy of the library.
        kernels: compiled kernels, or None.
        secret: of hidden inputs.
        tier: of the sandbox.
        limits: of each sandbox.
    """

    master: Master
    lesson: Lesson
    packages: Path
    kernels: Path | None
    secret: Secret
    tier: str
    limits: Limits = field(default_factory=Limits)


class Session:
    """A sandbox whose kernel runs."""

    def __init__(self, setting: Setting, sources: dict[str, str], lent: Collection[str] = ()):
        notebook = rebuilt(setting.master, sources, lent)
        job = Job(setting.packages, {"notebook.ipynb": notebook}, kernels=setting.kernels, limits=setting.limits)
        self.sandbox = Sandbox(job, setting.tier)
        self.executed = b""
        try:
            self._connection, _ = self.sandbox.accept(setting.limits.start_s, MOST_REPLY)
        except wire.ProtocolError:
            self.close()
            raise SandboxError("the kernel does not start") from None

    def begin(self, seconds: float) -> None:
        """Wait until all cells have run."""
        kind, number, word, arrays = self._connection.receive(time.monotonic() + seconds)
        if (kind, number, word) != ("hello", 0, "ready"):
            raise wire.ProtocolError("not the end of the cells")
        notebook = arrays.get("notebook")
        if notebook is not None and notebook.dtype.name == "uint8" and notebook.size <= 1 << 20:
            self.executed = notebook.tobytes()
        self.caller = wire.Caller(self._connection)

    def close(self) -> None:
        self.sandbox.close()


def _started(setting: Setting, cells: dict[str, str], lent: Collection[str]) -> Session:
    """A session; a second try where the first fails, before any cell of others has run.

    Raises:
        SandboxError: both fail.
    """
    with contextlib.suppress(SandboxError):
        return Session(setting, cells, lent)
    return Session(setting, cells, lent)


def untouched(source: str, stub: str) -> bool:
    """Whether a cell is still what the student was given."""
    return normalised(source) == normalised(stub)


def grade_lesson(setting: Setting, sources: dict[str, str]) -> tuple[dict[str, Outcome], dict[str, str]]:
    """Outcome of each exercise, and what its cell said when it was run, before the first hidden call.

    Args:
        setting: see `Setting`.
        sources: cell by exercise, or a NUL and a reason code.
    """
    outcomes: dict[str, Outcome] = {}
    usable: dict[str, str] = {}
    for exercise, rule in setting.lesson.exercises.items():
        cell = rule.of or exercise
        source = sources.get(cell, "\0cell_missing")
        if source.startswith("\0"):
            outcomes[exercise] = Outcome(0.0, "not_run", source[1:])
        elif untouched(source, setting.master.stubs[cell]):
            outcomes[exercise] = Outcome(0.0, "not_run", "not_done")
        else:
            usable[cell] = source
    run = _Run(setting, usable, outcomes)
    run.together()
    run.one_by_one()
    return {name: outcomes[name] for name in setting.lesson.exercises}, run.said


class _Run:
    """Sandboxes of a lesson: first one with all cells; then one for each exercise that is still open."""

    def __init__(self, setting: Setting, usable: dict[str, str], outcomes: dict[str, Outcome]):
        self._setting, self._usable, self._outcomes = setting, usable, outcomes
        self._names = {name: names_of(source) for name, source in usable.items()}
        self._in_company: dict[str, Outcome] = {}  # of exercises for which company was too much or too little
        self._company: dict[str, str] = {}  # cells that have run together
        self.said: dict[str, str] = {}

    def _open(self) -> list[str]:
        return [name for name in self._setting.lesson.exercises if name not in self._outcomes]

    def _cell(self, exercise: str) -> str:
        """Whose cell is asked: the exercise's own, or that of the one whose further task it is."""
        return self._setting.lesson.exercises[exercise].of or exercise

    def _needs(self, exercise: str) -> tuple[str, ...]:
        return self._setting.lesson.exercises[exercise].needs

    def _has_passed(self, exercise: str) -> bool:
        return exercise in self._outcomes and self._outcomes[exercise].status == "passed"

    def together(self) -> None:
        """All of the student's cells in one sandbox; an exercise that calls one that did not pass stays open.

        One that ends the sandbox stays open too, and its cell is left out from then on: another cell may have done it.
        """
        cells = dict(self._usable)
        while todo := [name for name in self._open() if self._own_parts(name, cells)]:
            with self._session(cells) as session:
                if isinstance(session, Outcome):
                    if session.status == "ungraded":
                        self._outcomes.update({name: session for name in todo})
                    return  # some cell spoils it for the others; each alone tells which
                self._company = self._company or dict(cells)
                ended = self._ask_all(session, todo, len(cells) < len(self._company))
                if not ended:
                    return
                del cells[self._cell(ended)]

    def _own_parts(self, exercise: str, cells: dict[str, str]) -> bool:
        return all(name in cells for name in (self._cell(exercise), *self._needs(exercise)))

    def _ask_all(self, session, todo: list[str], some_left: bool) -> str:
        """Grade in order; the exercise that ended the sandbox, or nothing. `some_left`: not all cells are there."""
        for name in todo:
            if not all(self._has_passed(need) for need in self._needs(name)):
                continue
            outcome, died = self._ask(session, name, dict.fromkeys(self._needs(name), "student"))
            if died:
                return name
            if outcome.status != "passed" and (self._shares_a_name(name) or (some_left and misses_a_name(outcome))):
                self._in_company[name] = outcome
            else:
                self._outcomes[name] = outcome
        return ""

    def _shares_a_name(self, exercise: str) -> bool:
        """Whether another cell binds a name that this one or a part of it binds: two helpers of the same name, say.

        The same import twice takes nothing away.
        """
        own = {self._cell(exercise), *self._needs(exercise)}
        others = [(self._names[name], self._names[one]) for name in own for one in self._usable if one != name]
        return any(mine[word] != its[word] or not mine[word] for mine, its in others for word in mine.keys() & its)

    def one_by_one(self) -> None:
        """Each exercise that is open in a sandbox of its own; what it calls is the reference where it did not pass.

        One that misses a name there is asked once more among all cells: an import or a helper may stand in another one.
        """
        for name in self._open():
            found = [self._apart(name, {})]
            if misses_a_name(found[0]) and self._company:
                found.append(self._apart(name, self._company))
            if name in self._in_company:
                found.append(self._in_company[name])
            self._outcomes[name] = max(found, key=lambda one: one.share)

    def _apart(self, name: str, company: dict[str, str]) -> Outcome:
        """Outcome of an exercise in a sandbox of its own, with its cell, what it calls, and company."""
        parts = {need: "student" if self._has_passed(need) else "reference" for need in self._needs(name)}
        lent = [need for need, whose in parts.items() if whose == "reference"]
        own = {self._cell(name), *parts} - {*lent}
        with self._session(company | {cell: self._usable[cell] for cell in own}, lent) as session:
            return session if isinstance(session, Outcome) else self._ask(session, name, parts)[0]

    @contextlib.contextmanager
    def _session(self, cells: dict[str, str], lent: Collection[str] = ()):
        """A session, or the outcome of everybody in it where there is none."""
        session = None
        try:
            try:
                session = _started(self._setting, cells, lent)
            except SandboxError:
                yield Outcome(0.0, "ungraded", "sandbox_failed")
                return
            try:
                session.begin(self._setting.limits.cells_s)
            except wire.ProtocolError as error:
                yield self._without_hello(session, error)
                return
            self.said = said_by(session.executed, self._setting.master.order) | self.said
            yield session
        finally:
            if session:
                session.close()

    def _without_hello(self, session, error) -> Outcome:
        """Why the cells did not run to their end, although the kernel did run."""
        if session.sandbox.killed_for:
            return Outcome(0.0, "error", f"too_much_{session.sandbox.killed_for}")
        if isinstance(error, wire.DeadlineError):
            return Outcome(0.0, "timeout", "cells_took_too_long")
        reason = "kernel_ended" if isinstance(error, wire.ClosedError) else "protocol"
        return Outcome(0.0, "error", reason)

    def _ask(self, session, exercise: str, parts: dict[str, str]) -> tuple[Outcome, bool]:
        """Outcome of an exercise's task, and whether the sandbox is of no more use."""
        deadline = time.monotonic() + self._setting.lesson.exercises[exercise].seconds
        marks, died, status = Marks(), False, ""

        def ask(arrays):
            error, answer = session.caller.ask(exercise, arrays, deadline - time.monotonic())
            return error_reason(error) if error else "", answer

        try:
            task_of(exercise)(self._setting.secret.generator(exercise), ask, marks)
        except wire.ProtocolError as problem:
            died, marks.share = True, 0.0
            status, marks.reason = cut_off(problem, session.sandbox.killed_for)
        share = min(1.0, round(marks.share, 9))
        status = status or ("passed" if marks.passed else "partial" if share else "failed")
        names = parts | {self._cell(exercise): "student"}
        source = "+".join(f"{name}:{whose}" for name, whose in names.items())
        return Outcome(share, status, marks.reason, source, marks.detail), died


def cut_off(problem: wire.ProtocolError, killed_for: str) -> tuple[str, str]:
    """Status and reason code of a question that got no answer."""
    if killed_for:
        return "error", f"too_much_{killed_for}"
    if isinstance(problem, wire.DeadlineError):
        return "timeout", "took_too_long"
    return "error", "kernel_ended" if isinstance(problem, wire.ClosedError) else "protocol"


def misses_a_name(outcome: Outcome) -> bool:
    """Whether a name was not there: of what a function uses, or of itself since its cell ended early."""
    return not {"raised_NameError", "not_defined"}.isdisjoint([outcome.reason, *outcome.detail.get("wrong", [])])


def error_reason(name: str) -> str:
    """Reason code of an exception: its type where Python knows it."""
    if name == "NotImplementedError":
        return "not_done"
    if name == "NotDefined":  # of `adapters`
        return "not_defined"
    return f"raised_{name}" if name in KNOWN_ERRORS else "raised_an_error"
