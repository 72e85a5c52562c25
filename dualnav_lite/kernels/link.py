"""The radio link between the off-board mapper and the robot: loss, bursts and delay, one packet a control step."""

from numba import njit

from dualnav_lite.kernels.grid import copy_grid
from dualnav_lite.kernels.hashing import hash_uniform


@njit(cache=True)
def is_packet_lost(key, step, loss, burst, was_lost):
    """Whether the packet of a step is lost.

    With `burst` 0 packets are lost independently. Else they are lost in runs of mean `burst` packets, at the same
    average share: a two-state chain whose bad state loses everything.

    Source: Gilbert, Bell System Technical Journal 39 (1960), with a good state that loses nothing.
    """
    u = hash_uniform(key, step)
    if burst == 0.0 or step == 0:  # the first packet is drawn from the chain's stationary law
        return u < loss
    return u < (1.0 - 1.0 / burst if was_lost else loss / (1.0 - loss) / burst)


@njit(cache=True)
def deliver_maps(
    cells,
    corners,
    poses,
    step,
    active,
    delay,
    loss,
    burst,
    keys,
    is_lost,
    ring_sent,
    ring_cells,
    ring_corners,
    ring_poses,
    received,
    received_corners,
    received_poses,
    age_steps,
):
    """Send the present map of each world and hand over the one that arrives now.

    Args:
        cells, corners, poses: (n, G, G), (n, 2), (n, 3) what is sent: map, its window, where the robot was.
        step: (n,) i64, from 0 at reset, one more at every call.
        active: (n,) bool, the others stay as they are.
        delay: (n,) i64 steps under way; loss: (n,) share lost; burst: (n,) mean run of losses [packets] or 0.
        keys: (n,) u64.
        is_lost: (n,) bool whether the last packet was lost, changed in place.
        ring_sent: (n, depth) bool, ring_*: what is under way, likewise; depth > the longest delay.
        received, received_corners, received_poses: what the robot holds, likewise.
        age_steps: (n,) i64 steps since that was sent, likewise; 0 at reset.
    """
    for i in range(len(cells)):
        if not active[i]:
            continue
        age_steps[i] += 1
        is_lost[i] = is_packet_lost(keys[i], step[i], loss[i], burst[i], is_lost[i])
        if delay[i] == 0:
            if not is_lost[i]:
                copy_grid(cells[i], received[i])
                received_corners[i], received_poses[i], age_steps[i] = corners[i], poses[i], 0
            continue
        slots = delay[i] + 1
        now, then = step[i] % slots, (step[i] + 1) % slots  # the oldest slot left `delay` steps ago
        ring_sent[i, now] = not is_lost[i]
        if not is_lost[i]:
            copy_grid(cells[i], ring_cells[i, now])
            ring_corners[i, now], ring_poses[i, now] = corners[i], poses[i]
        if ring_sent[i, then]:
            copy_grid(ring_cells[i, then], received[i])
            received_corners[i], received_poses[i] = ring_corners[i, then], ring_poses[i, then]
            age_steps[i] = delay[i]
