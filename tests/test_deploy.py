import io

import numpy as np
import onnxruntime
import pytest
import torch

from dualnav_lite.config import Config, Hardware, UnusableInput, with_overrides
from dualnav_lite.deploy import EmbeddedPolicy, card_of, export
from dualnav_lite.drivers import make_driver, trained_ablations
from dualnav_lite.planners.sampling import command_grid
from dualnav_lite.policy import Actor, CommandGridHead, make_actor
from dualnav_lite.studies import load_study
from dualnav_lite.trunks import HIDDEN, ImageTrunk


def untrained(channels=4):
    torch.manual_seed(1)
    actor = Actor(ImageTrunk(channels), CommandGridHead(HIDDEN, command_grid(Hardware())))
    torch.nn.init.normal_(actor.head.linear.weight, std=0.05)  # else every command is as likely as the next
    return actor


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    actor, folder = untrained(), tmp_path_factory.mktemp("策略 导出")  # a path with spaces and another script
    return actor, export(actor, card_of(actor, Config(), memory=0.5, training_seed=7), folder)


def some_states(n=64, seed=0):
    states = np.random.default_rng(seed).random((n, 4, 64, 64), np.float32)
    states[: n // 4] = 0.0
    states[n // 4 : n // 2, 1] *= -1.0
    return states


def test_exports_give_the_probabilities_of_the_network_and_stay_small(exported):
    actor, paths = exported
    states = some_states()
    expected = actor(torch.from_numpy(states)).exp().detach().numpy()
    for ending in ("pt", "onnx"):
        assert np.abs(EmbeddedPolicy(paths[ending]).output(states) - expected).max() < 1e-5
    assert all(path.stat().st_size < 8_000_000 for path in paths.values())


def test_weights_load_through_an_open_file_without_running_code(exported):
    actor, paths = exported
    twin = untrained()
    torch.nn.init.zeros_(twin.head.linear.weight)
    with open(paths["pth"], "rb") as file:
        twin.load_state_dict(torch.load(io.BytesIO(file.read()), weights_only=True))
    states = torch.from_numpy(some_states(4))
    assert torch.equal(twin(states), actor(states))


def test_same_bits_alone_and_among_others(exported):
    policy = EmbeddedPolicy(exported[1]["onnx"])
    states = some_states(64)
    together = policy.output(states)
    for size in (1, 2, 7, 16):
        assert np.array_equal(policy.output(states[:size]), together[:size])


def test_get_action_is_act_for_one_robot(exported):
    states = some_states(5)
    alone, many = EmbeddedPolicy(exported[1]["onnx"]), EmbeddedPolicy(exported[1]["onnx"])
    rows = np.repeat(states[:, None], 3, axis=1)
    for state, batch in zip(states, rows, strict=True):
        action = alone.get_action(torch.from_numpy(state[None]))
        assert action.shape == (2,)
        assert np.array_equal(many.act(batch), [action] * 3)


def test_actions_lie_within_the_limits_and_remember_only_until_a_reset(exported):
    policy = EmbeddedPolicy(exported[1]["pt"])
    states = some_states(12, seed=3)
    first = policy.get_action(states[:1])
    second = policy.get_action(states[-1:])
    policy.reset([0])
    assert np.array_equal(policy.get_action(states[:1]), first)
    policy.reset([0])
    assert not np.array_equal(policy.get_action(states[-1:]), second)
    actions = policy.act(states)
    assert (np.abs(actions) <= np.array([0.8, 1.2]) + 1e-9).all()


def test_a_world_without_an_open_goal_is_not_asked_about_and_keeps_its_votes(exported):
    policy, twin = EmbeddedPolicy(exported[1]["onnx"]), EmbeddedPolicy(exported[1]["onnx"])
    states, asked = some_states(3, seed=5), []
    output = policy.output
    policy.output = lambda observations: asked.append(len(observations)) or output(observations)
    policy.act(states, [{"idle": False}] * 3)
    commands = policy.act(states[::-1], [{"idle": False}, {"idle": True}, {"idle": False}])
    assert asked == [3, 2]
    assert not commands[1].any()
    twin.act(states)
    expected = twin.act(states[::-1])
    assert np.array_equal(commands[[0, 2]], expected[[0, 2]])
    policy.act(states, [{"idle": True}] * 3)
    assert asked == [3, 2]


def test_files_know_what_they_were_trained_with(exported):
    for ending in ("pt", "onnx"):
        policy = EmbeddedPolicy(exported[1][ending], Config())
        assert policy.training_seed == 7
        assert len(policy.fingerprint) == 64


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"observation.intensity": False}, "observation.intensity: True"),
        ({"observation.motion.method": "none"}, "observation.motion.method: forecast"),
        ({"guide.method": "goal"}, "guide.method: astar"),
    ],
)
def test_a_config_whose_observation_does_not_fit_is_refused_by_name(exported, changes, named):
    with pytest.raises(UnusableInput, match=named):
        EmbeddedPolicy(exported[1]["onnx"], with_overrides(Config(), changes))


def test_unusable_files_end_in_one_line(exported, tmp_path):
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"not a model")
    missing = tmp_path / "missing.pt"
    weights = exported[1]["pth"]  # weights of another layout than a program
    for path in (broken, missing, weights):
        with pytest.raises(UnusableInput) as caught:
            EmbeddedPolicy(path)
        assert "\n" not in str(caught.value)
        assert path.name in str(caught.value)
    with pytest.raises(UnusableInput, match="no such model"):
        make_driver("ablation_that_nobody_trained")


def test_observations_of_another_layout_are_refused(exported):
    with pytest.raises(ValueError, match="4, 64, 64"):
        EmbeddedPolicy(exported[1]["onnx"]).act(np.zeros((1, 3, 64, 64)))


def test_a_gaussian_policy_is_exported_as_its_mean_command(tmp_path):
    torch.manual_seed(2)
    actor = make_actor((4, 64, 64), "gaussian", [0.8, 1.2])
    torch.nn.init.normal_(actor.head.linear.weight, std=0.05)
    states = some_states(6)
    with torch.no_grad():
        expected = actor(torch.from_numpy(states)).chunk(2, dim=1)[0].numpy() * [0.8, 1.2]
    for ending, path in export(actor, card_of(actor, Config(), memory=0.5), tmp_path).items():
        if ending != "pth":
            np.testing.assert_allclose(EmbeddedPolicy(path).act(states), expected, atol=1e-5)


def test_drivers_are_found_by_name_or_file(exported):
    assert make_driver("straight", Config()).needs_truth is False
    assert make_driver(str(exported[1]["onnx"]), Config()).training_seed == 7
    filtered = make_driver(f"{exported[1]['onnx']}_filter", Config())
    assert filtered.training_seed == 7
    assert filtered.fingerprint != make_driver(str(exported[1]["onnx"]), Config()).fingerprint
    with pytest.raises(UnusableInput, match="unknown arm 'nobody'"):
        make_driver("nobody", Config())
    with pytest.raises(UnusableInput, match=r"'ppo@max_speed=1': a trained policy has no knob; .* --preference"):
        make_driver("ppo@max_speed=1", Config())


def test_every_ablation_of_the_study_is_an_arm_that_is_driven_as_it_was_trained():
    names = [f"ablation_{variant}" for variant in load_study("ablation").variants]
    assert trained_ablations() == sorted(names)
    for name in names:  # one ends like the safety filter's mark, and is none
        assert make_driver(name, Config()).card["training"] == f"ablation: {name.removeprefix('ablation_')}"


def test_an_ablation_brings_the_settings_it_was_trained_under(tmp_path):
    actor = untrained(3)
    config = with_overrides(Config(), {"observation.intensity": False})
    card = card_of(actor, config, memory=0.5, overrides={"observation.intensity": False})
    policy = EmbeddedPolicy(export(actor, card, tmp_path)["onnx"])
    assert policy.own_config(Config()) == config


def test_onnx_file_names_what_goes_in_and_out(exported):
    session = onnxruntime.InferenceSession(exported[1]["onnx"].read_bytes(), providers=["CPUExecutionProvider"])
    assert [one.name for one in session.get_inputs()] == ["state"]
    assert [one.name for one in session.get_outputs()] == ["output"]
