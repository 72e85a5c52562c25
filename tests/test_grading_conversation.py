"""Whole exchanges with a child that lies: whatever it says and whenever, points come from right answers alone."""

import json
import random
import socket
import threading
import time
import tracemalloc
import types

import numpy as np
import pytest

from grading import wire
from grading.job import Limits
from grading.lesson import KNOWN_ERRORS, MOST_REPLY, _Run
from grading.rubric import load_rubric
from grading.secret import Secret
from grading.tasks import questions_of

SECRET = Secret(b"conversation" * 4, "conversation")
LESSON = load_rubric().lessons["07_rewards"]
EXERCISE = "goal"
QUESTIONS = questions_of(EXERCISE)(SECRET.generator(EXERCISE))
CODES = {
    "", "kernel_ended", "took_too_long", "protocol", "wrong_type", "wrong_shape", "not_finite", "not_done",
    "raised_an_error", *(f"raised_{name}" for name in KNOWN_ERRORS), *(question.hint for question in QUESTIONS),
}  # fmt: skip


def frame(header, payload=b"", announced=None) -> bytes:
    """A frame with any header, which may announce another payload than it brings."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return wire.PREFIX.pack(wire.MAGIC, len(text), len(payload) if announced is None else announced) + text + payload


def reply(number, arrays, payload=b"", **more) -> dict:
    return {"kind": "reply", "id": number, "word": "", "arrays": arrays} | more


LIES = {
    "zeros": lambda n, right, rng: wire.pack("reply", n, "", {"values": np.zeros_like(right)}),
    "not finite": lambda n, right, rng: wire.pack("reply", n, "", {"values": right * rng.choice([np.nan, np.inf])}),
    "almost": lambda n, right, rng: wire.pack("reply", n, "", {"values": right * 1.001 + 0.001}),
    "integers": lambda n, right, rng: wire.pack("reply", n, "", {"values": right.astype(np.int64)}),
    "booleans": lambda n, right, rng: wire.pack("reply", n, "", {"values": right.astype(bool)}),
    "bytes": lambda n, right, rng: wire.pack("reply", n, "", {"values": right.view(np.uint8)}),
    "flat": lambda n, right, rng: wire.pack("reply", n, "", {"values": right[None]}),
    "one number": lambda n, right, rng: wire.pack("reply", n, "", {"values": np.array(right[0])}),
    "nothing": lambda n, right, rng: wire.pack("reply", n, "", {}),
    "more": lambda n, right, rng: wire.pack("reply", n, "", {"values": right, "score": np.array(1.0)}),
    "other name": lambda n, right, rng: wire.pack("reply", n, "", {"value": right}),
    "error": lambda n, right, rng: wire.pack("error", n, rng.choice(["ValueError", "Passed", "x" * 64, ""]), {}),
    "hello": lambda n, right, rng: wire.pack("hello", 0, "", {"values": right}),
    "call": lambda n, right, rng: wire.pack("call", n, "goal", {"values": right}),
    "late": lambda n, right, rng: wire.pack("reply", n - 1, "", {"values": right}),
    "early": lambda n, right, rng: wire.pack("reply", n + 1, "", {"values": right}),
    "twice": lambda n, right, rng: 2 * wire.pack("reply", n, "", {"values": right + 1.0}),
    "verdict": lambda n, right, rng: frame(reply(n, [], score=1, passed=True)),
    "object": lambda n, right, rng: frame(reply(n, [["values", "object", [1]]]), b"\x80\x04N." + bytes(4)),
    "text dtype": lambda n, right, rng: frame(reply(n, [["values", "U3", [1]]]), bytes(12)),
    "big-endian": lambda n, right, rng: frame(reply(n, [["values", ">f8", [12]]]), bytes(96)),
    "negative": lambda n, right, rng: frame(reply(n, [["values", "float64", [-12]]]), bytes(96)),
    "empty and vast": lambda n, right, rng: frame(reply(n, [["values", "bool", [0, 2**26, 2**26, 2**26]]])),
    "huge": lambda n, right, rng: frame(reply(n, [["values", "uint8", [1 << 25]]]), announced=1 << 25),
    "deep": lambda n, right, rng: frame(b"[" * rng.randrange(5, 16_000)),
    "long number": lambda n, right, rng: frame(b'{"kind":"reply","id":' + b"9" * 9_000 + b',"word":"","arrays":[]}'),
    "constant": lambda n, right, rng: frame(b'{"kind":"reply","id":NaN,"word":"","arrays":[]}'),
    "noise": lambda n, right, rng: rng.randbytes(rng.randrange(1, 400)),
    "wrong magic": lambda n, right, rng: b"HTTP" + wire.pack("reply", n, "", {"values": right})[4:],
    "half": lambda n, right, rng: wire.pack("reply", n, "", {"values": right})[: rng.randrange(1, 150)],
    "silence": lambda n, right, rng: b"",
}


def lie(there: socket.socket, seed: int, told: list[int]) -> None:
    """The child: answers some calls rightly, which it notes, and others with a lie, whole or in pieces."""
    rng, connection = random.Random(seed), wire.Connection(there)
    try:
        while True:
            _, number, _, _ = connection.receive()
            right = QUESTIONS[number - 1].expected["values"]
            if rng.random() < 0.5:
                told.append(number - 1)
                answer = wire.pack("reply", number, "", {"values": right})
            else:
                answer = LIES[rng.choice(sorted(LIES))](number, right, rng)
            while answer:
                size = rng.choice([1, 7, 16, 100, len(answer)])
                there.sendall(answer[:size])
                answer = answer[size:]
            if rng.random() < 0.1:
                return
    except (wire.ProtocolError, OSError):
        pass
    finally:
        there.close()


def converse(seed: int):
    """Outcome of an exercise asked from a liar, and the shares of the questions that it answered rightly."""
    here, there = socket.socketpair()
    told: list[int] = []
    child = threading.Thread(target=lie, args=(there, seed, told))
    child.start()
    exercise = LESSON.exercises[EXERCISE].model_copy(update={"seconds": 0.3})
    lesson = LESSON.model_copy(update={"exercises": {EXERCISE: exercise}})
    setting = types.SimpleNamespace(lesson=lesson, secret=SECRET, limits=Limits())
    sandbox = types.SimpleNamespace(killed_for="")
    session = types.SimpleNamespace(caller=wire.Caller(wire.Connection(here, MOST_REPLY)), sandbox=sandbox)
    try:
        outcome, died = _Run(setting, {EXERCISE: ""}, {})._ask(session, EXERCISE, {})
    finally:
        here.close()
        child.join()
    return outcome, died, told


def many(seeds) -> dict[str, int]:
    """How often each status came up; every outcome is checked."""
    counts: dict[str, int] = {}
    for seed in seeds:
        outcome, died, told = converse(seed)
        deserved = sum(QUESTIONS[k].share for k in told)
        assert 0.0 <= outcome.share <= deserved + 1e-9, (seed, outcome, told)
        assert outcome.reason in CODES, (seed, outcome)
        assert not died or outcome.share == 0.0
        assert (outcome.status == "passed") == (outcome.share == 1.0)
        counts[outcome.status] = counts.get(outcome.status, 0) + 1
    return counts


def test_a_lying_child_gets_what_its_right_answers_deserve():
    assert sum(many(range(120)).values()) == 120


@pytest.mark.slow
def test_four_thousand_lying_children_get_what_their_right_answers_deserve():
    assert sum(many(range(1_000, 5_000)).values()) == 4_000


@pytest.mark.parametrize("name", sorted(LIES))
def test_every_lie_alone_is_worth_nothing(name):
    here, there = socket.socketpair()
    question = QUESTIONS[1]
    there.settimeout(5)

    def answer():
        wire.Connection(there).receive()
        there.sendall(LIES[name](1, question.expected["values"], random.Random(name)))

    child = threading.Thread(target=answer)
    child.start()
    try:
        error, arrays = wire.Caller(wire.Connection(here, MOST_REPLY)).ask(EXERCISE, question.arrays, 0.3)
        assert error or question.judge(arrays)
    except wire.ProtocolError:
        pass
    finally:
        child.join()
        here.close()
        there.close()


@pytest.mark.parametrize("payload", [MOST_REPLY, MOST_REPLY + 1, 1 << 40, 2**64 - 1])
def test_what_is_announced_and_never_sent_costs_at_most_one_frame(payload):
    here, there = socket.socketpair()
    sizes = [["values", "uint8", [min(payload, 1 << 26)]]]
    there.sendall(frame(reply(1, sizes), announced=payload))
    tracemalloc.start()
    try:
        with pytest.raises(wire.ProtocolError):
            wire.Connection(here, MOST_REPLY).receive(time.monotonic() + 0.2)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        here.close()
        there.close()
    assert most < (1.2 * MOST_REPLY if payload == MOST_REPLY else 1 << 20)
