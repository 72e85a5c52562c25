"""Folders handed in, made of the table of attacks."""

import json
import os
import pickle
import zipfile
from pathlib import Path

from grading.attacks.table import Attack
from grading.rebuild import text_of

ATTACKED = "goal"
BEFORE = '''opened = []


def must_fail(door, action):
    """Note a door that opens."""
    try:
        action()
    except BaseException:
        return
    opened.append(door)


'''
AFTER = """

if opened:
    print("OPENED", opened)
    del goal
"""
WIRE = '''
import json, os, sys, time
sys.path.append(os.environ["GRADING_FOLDER"])
import wire

honest = goal


def goal(before, after, reached, gamma):
    """Answers by itself, over the server's own connection."""
    frame = sys._getframe()
    while "connection" not in frame.f_locals:
        frame = frame.f_back
    connection, number = frame.f_locals["connection"]._socket, frame.f_locals["number"]
    right = honest(before, after, reached, gamma)
    {statements}
    return right
'''


class _Payload:
    """Runs a statement where it is unpickled."""

    def __init__(self, statement: str):
        self._statement = statement

    def __reduce__(self):
        return exec, (self._statement,)


def _filled(text: str, places: dict[str, str]) -> str:
    for name, value in places.items():
        text = text.replace(f"@{name}@", value)
    return text


def source_of(attack: Attack, reference: str, places: dict[str, str]) -> str:
    """The attacked cell.

    Args:
        attack: of the table.
        reference: right solution of the exercise.
        places: what stands where, by name.
    """
    if attack.cell_of:
        before, text, count, after = attack.cell_of.get("around") or ["", *attack.cell_of["repeat"], ""]
        return before + text * count + after
    if attack.wire:
        return reference + WIRE.replace("{statements}", attack.wire.strip().replace("\n", "\n    "))
    cell = _filled(attack.cell, places)
    return BEFORE + cell + "\n\n" + reference + AFTER if attack.honest else cell


def _notebook(attack: Attack, lesson: Path, places: dict[str, str]) -> bytes:
    """The teacher's notebook with one cell exchanged, and with whatever is forged around it."""
    notebook, forged = json.loads(lesson.read_text(encoding="utf-8")), attack.notebook
    for cell in notebook["cells"]:
        if cell.get("id") == ATTACKED:
            cell["source"] = source_of(attack, text_of(cell["source"]) or "", places)
            cell["metadata"] |= forged.get("cell", {})
            cell["outputs"] = forged.get("outputs", [])
            if forged.get("half_character"):
                cell["source"] = "\ud800"
    for one in forged.get("extra", []):
        metadata = {"tags": one.get("tags", []), "nbgrader": {"grade_id": one.get("grade_id"), "points": 99}}
        notebook["cells"].insert(0, {"cell_type": "code", "metadata": metadata, "outputs": [], "score": 99, **one})
    notebook["metadata"] |= forged.get("metadata", {})
    return _filled(json.dumps(notebook), places).encode("utf-8")


def _network(value: float) -> bytes:
    """An exported policy whose commands are all the same number."""
    from onnx import TensorProto, helper

    numbers = {"zero": [0.0, 0.0], "value": [float(value), float(value)]}
    constants = [helper.make_tensor(name, TensorProto.FLOAT, [2], list_) for name, list_ in numbers.items()]
    constants.append(helper.make_tensor("axes", TensorProto.INT64, [2], [2, 3]))
    constants += [helper.make_tensor(name, TensorProto.INT64, [1], [n]) for name, n in (("a", 0), ("b", 2), ("one", 1))]
    nodes = [
        helper.make_node("ReduceMax", ["state", "axes"], ["most"], keepdims=0),
        helper.make_node("Slice", ["most", "a", "b", "one"], ["two"]),
        helper.make_node("Mul", ["two", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "value"], ["action"]),
    ]
    state = helper.make_tensor_value_info("state", TensorProto.FLOAT, ["n", 4, 64, 64])
    action = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 2])
    graph = helper.make_graph(nodes, "attack", [state], [action], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    helper.set_model_props(model, {"card": json.dumps({"grid": None, "memory": 0.0})})
    return model.SerializeToString()


def _put(path: Path, what, places: dict[str, str]) -> None:
    """One further file, in place of one that is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    if isinstance(what, str):
        path.write_text(_filled(what, places), encoding="utf-8")
    elif "link" in what:
        path.symlink_to(_filled(what["link"], places))
    elif "folders" in what:
        for number in range(what["folders"]):
            (path / str(number)).mkdir(parents=True)
    elif "pipe" in what:
        os.mkfifo(path)
    elif "sparse" in what:
        with open(path, "wb") as file:
            file.truncate(what["sparse"])
    elif "repeat" in what:
        text, count = what["repeat"]
        path.write_text(text * count, encoding="utf-8")
    elif "pickle" in what:
        path.write_bytes(pickle.dumps(_Payload(_filled(what["pickle"], places))))
    elif "torch_archive" in what:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("archive/data.pkl", pickle.dumps(_Payload(_filled(what["torch_archive"], places)), 2))
            archive.writestr("archive/version", "3\n")
    elif "network_that_says" in what:
        path.write_bytes(_network(what["network_that_says"]))
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("archive/version", "3\n")
            with archive.open("archive/data.pkl", "w") as file:
                for _ in range(what["zip_of_zeros"] >> 20):
                    file.write(bytes(1 << 20))


def hand_in(attack: Attack, room: Path, lesson: Path, places: dict[str, str]) -> Path:
    """The folder of one attack.

    Args:
        attack: of the table.
        room: folder of all submissions.
        lesson: the teacher's notebook.
        places: what stands where, by name.
    """
    folder = room / (attack.folder or attack.name)
    folder.mkdir(parents=True)
    (folder / lesson.name).write_bytes(_notebook(attack, lesson, places))
    for name, what in attack.put.items():
        _put(folder / name, what, places)
    return folder
