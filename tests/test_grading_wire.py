"""Frames: whatever bytes arrive, the answer is arrays or a ProtocolError, in bounded memory and time."""

import json
import random
import socket
import threading
import time

import numpy as np
import pytest

from grading import wire

FRAMES = [
    wire.pack("hello", 0, "", {}),
    wire.pack("call", 1, "gae", {"rewards": np.arange(6.0).reshape(2, 3), "terminated": np.zeros((2, 3), bool)}),
    wire.pack("reply", 7, "", {"values": np.float32([1.5, np.nan]), "n": np.array(3), "b": np.zeros((0, 4), "uint8")}),
    wire.pack("error", 9, "ValueError", {}),
]


def read(frame: bytes):
    """What a frame in memory says."""
    header, payload = wire.lengths(frame[:16])
    rest = frame[16:]
    if len(rest) != header + payload:
        raise wire.ClosedError("short")
    return wire.unpack(rest[:header], rest[header:])


def with_header(header, payload=b"") -> bytes:
    """A frame with any header."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return wire.PREFIX.pack(wire.MAGIC, len(text), len(payload)) + text + payload


def test_arrays_come_back_as_they_were():
    kind, number, word, arrays = read(FRAMES[1])
    assert (kind, number, word) == ("call", 1, "gae")
    assert arrays["rewards"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert arrays["rewards"].dtype == np.float64
    assert arrays["terminated"].dtype == bool
    assert read(FRAMES[2])[3]["n"].shape == ()
    assert read(FRAMES[2])[3]["b"].shape == (0, 4)


BASE = {"kind": "reply", "id": 1, "word": "", "arrays": []}


@pytest.mark.parametrize(
    "frame",
    [
        b"XXXX" + FRAMES[0][4:],
        wire.PREFIX.pack(wire.MAGIC, 2**32 - 1, 0),
        wire.PREFIX.pack(wire.MAGIC, 20, 2**63),
        with_header(b"[" * 5000),
        with_header(b'{"kind":' * 900 + b"}" * 900),
        with_header(b'{"kind":"reply","kind":"hello","id":1,"word":"","arrays":[]}'),
        with_header(b"\xff\xfe\x00\x01"),
        with_header(b'{"kind":"reply","id":NaN,"word":"","arrays":[]}'),
        with_header(b'{"kind":"reply","id":1' + b"0" * 5000 + b',"word":"","arrays":[]}'),
        with_header(BASE | {"score": 10}),
        with_header(BASE | {"id": True}),
        with_header(BASE | {"id": -1}),
        with_header(BASE | {"kind": "score"}),
        with_header(BASE | {"word": "a b"}),
        with_header(BASE | {"word": "a" * 65}),
        with_header(BASE | {"arrays": [["a", "object", [1]]]}, b"12345678"),
        with_header(BASE | {"arrays": [["a", "float64", [2]]]}, b"12345678"),
        with_header(BASE | {"arrays": [["a", "float64", [-1]]]}, b"12345678"),
        with_header(BASE | {"arrays": [["a", "float64", [2**26, 2**26, 2**26, 2**26]]]}, b"12345678"),
        with_header(BASE | {"arrays": [["a", "uint8", [0, 2**26, 2**26, 2**26]]]}),
        with_header(BASE | {"arrays": [["a", "bool", [1]]]}, b"\x02"),
        with_header(BASE | {"arrays": [["a", "uint8", [1]], ["a", "uint8", [1]]]}, b"12"),
        with_header(BASE, b"left over"),
    ],
)
def test_what_breaks_a_rule_is_a_protocol_error(frame):
    with pytest.raises(wire.ProtocolError):
        read(frame)


def test_objects_are_not_sent():
    with pytest.raises(wire.ProtocolError):
        wire.pack("reply", 1, "", {"a": np.array([object()])})
    with pytest.raises(wire.ProtocolError):
        wire.pack("reply", 1, "", {"a": np.array(["text"])})


def mutate(frame: bytes, rng: random.Random) -> bytes:
    """A frame with some bytes changed, cut, repeated or put in, and often with lengths that fit again."""
    data = bytearray(frame)
    for _ in range(rng.randint(1, 4)):
        place = rng.randrange(len(data)) if data else 0
        match rng.randrange(5):
            case 0 if data:
                data[place] = rng.randrange(256)
            case 1:
                del data[place : place + rng.randrange(1, 9)]
            case 2:
                data[place:place] = data[place : place + rng.randrange(1, 30)]
            case 3:
                data[place:place] = rng.choice([b"[", b"{", b'"', b"0", b"9" * 30, b"1e999", b"null", b"\\ud800", b"-"])
            case 4 if len(data) >= 16:
                header = rng.choice([0, 2, len(data) - 16, 2**32 - 1, rng.randrange(2**16)])
                data[4:16] = header.to_bytes(4, "little") + rng.choice([0, 2**64 - 1, 48]).to_bytes(8, "little")
    if rng.random() < 0.6 and len(data) > 20:
        header = min(int.from_bytes(frame[4:8], "little"), len(data) - 16)
        data[:16] = wire.PREFIX.pack(wire.MAGIC, header, len(data) - 16 - header)
    return bytes(data)


def fuzz(count: int, seed: int) -> int:
    """Mutated frames that were refused; anything but a ProtocolError comes through and fails the test."""
    rng, refused = random.Random(seed), 0
    for _ in range(count):
        try:
            kind, number, word, arrays = read(mutate(rng.choice(FRAMES), rng))
        except wire.ProtocolError:
            refused += 1
        else:
            assert kind in wire.KINDS
            assert 0 <= number < 2**53
            assert wire._is_word(word)
            assert all(array.dtype in wire.DTYPES.values() for array in arrays.values())
    return refused


def test_mutated_frames_are_read_or_refused():
    assert 1000 < fuzz(4_000, 1) < 4_000


@pytest.mark.slow
def test_two_hundred_thousand_mutated_frames_are_read_or_refused():
    assert fuzz(200_000, 2) < 200_000


@pytest.fixture
def pair():
    """A caller and the other end of its socket."""
    here, there = socket.socketpair()
    yield wire.Caller(wire.Connection(here, 1 << 20)), there
    here.close()
    there.close()


def test_one_deadline_covers_a_frame_that_comes_drop_by_drop(pair):
    caller, there = pair

    def drip():
        try:
            for byte in wire.pack("reply", 1, "", {"values": np.zeros(200)}):
                there.send(bytes([byte]))
                time.sleep(0.02)
        except OSError:
            pass

    thread = threading.Thread(target=drip)
    thread.start()
    start = time.monotonic()
    with pytest.raises(wire.DeadlineError):
        caller.ask("gae", {}, 0.3)
    assert time.monotonic() - start < 5
    there.close()
    thread.join()


@pytest.mark.parametrize(
    "answer",
    [
        wire.pack("reply", 2, "", {}),  # early
        wire.pack("call", 1, "gae", {}),
        wire.pack("hello", 1, "", {}),
        wire.PREFIX.pack(wire.MAGIC, 20, 1 << 30),  # longer than the scorer takes
    ],
)
def test_only_the_answer_to_this_call_counts(pair, answer):
    caller, there = pair
    there.sendall(answer)
    with pytest.raises(wire.ProtocolError):
        caller.ask("gae", {}, 1.0)


def test_a_reply_that_was_sent_twice_spoils_the_next_call(pair):
    caller, there = pair

    def answer_twice():
        there.recv(4096)
        there.sendall(2 * wire.pack("reply", 1, "", {"values": np.zeros(1)}))

    thread = threading.Thread(target=answer_twice)
    thread.start()
    assert caller.ask("gae", {}, 5.0)[0] == ""
    thread.join()
    with pytest.raises(wire.ProtocolError, match="before its call"):
        caller.ask("gae", {}, 5.0)


def test_an_answer_that_was_there_before_its_call_is_none(pair):
    caller, there = pair
    there.sendall(wire.pack("reply", 1, "", {"values": np.zeros(1)}))
    with pytest.raises(wire.ProtocolError, match="before its call"):
        caller.ask("gae", {}, 5.0)


def test_an_end_of_file_is_told_apart(pair):
    caller, there = pair
    there.close()
    with pytest.raises(wire.ClosedError):
        caller.ask("gae", {}, 1.0)
