# %% [markdown]
# # 01 World: wheels, watts, and people in the way
#
# **Aim**: write how the robot moves, how its wheels keep their speed and what that costs, then see what people in the
# way do to a planner.
#
# **Time**: 40 minutes for you, 12 s of CPU. **Number to expect**: the cheapest speed is **0.50 m/s**, at
# **28 J/m**.
#
# The robot has two driven wheels. Everything it can do is: turn the left one, turn the right one.

# %% tags=["parameters"]
quick = False  # the tests run this notebook with fewer pictures

# %% tags=["given"]
import numpy as np

from dualnav_lite.check import check

TRACK = 0.30  # [m] between the wheels
MASS = 15.0  # [kg]
KP, KI, KD = 1.2, 4.0, 0.01  # gains of the wheel loop
MOST_INTEGRAL = 0.2  # [m]

# %%
import matplotlib.pyplot as plt
import pandas as pd
from IPython.display import display

from dualnav_lite.config import with_overrides
from dualnav_lite.figures.lesson import BLUE, GREEN, GREY, ORANGE, RED, drive, film, lesson_style, photo, planned
from dualnav_lite.scenario import load_scenario

lesson_style()


# %% [markdown]
# ## 1. Two wheels make a curve
#
# With wheel speeds $v_l, v_r$ [m/s] at the rim and the track $b$ between them:
#
# $$v = \frac{v_l + v_r}{2} \qquad \omega = \frac{v_r - v_l}{b}$$
#
# During a short step $dt$ the heading turns by $\omega\,dt$. So drive along the heading in the *middle* of the step,
# $\theta_m = \theta + \tfrac12 \omega\,dt$:
#
# $$x \mathrel{+}= v\cos\theta_m\,dt \qquad y \mathrel{+}= v\sin\theta_m\,dt \qquad \theta \mathrel{+}= \omega\,dt$$
#
# **Exercise `step_pose`** (easy, important, 5 minutes). `pose` is an array x [m], y [m], heading [rad],
# counter-clockwise. Return the new one, and leave the old one as it is.

# %% grade_id="step_pose" tags=["solution"]
def step_pose(pose, v_left, v_right, track, dt):
    """(3,) pose after dt seconds at two wheel speeds [m/s]."""
    ### BEGIN SOLUTION
    v, omega = 0.5 * (v_left + v_right), (v_right - v_left) / track
    middle = pose[2] + 0.5 * omega * dt
    return pose + np.array([v * np.cos(middle), v * np.sin(middle), omega]) * dt
    ### END SOLUTION


# %% grade_id="step_pose_check" points=2 tags=["check"]
check("step_pose", step_pose)


# %%
def track_of(v_left, v_right, seconds=6.0, dt=0.1):
    """(steps, 3) poses from the origin on."""
    poses = [np.zeros(3)]
    for _ in range(round(seconds / dt)):
        poses.append(step_pose(poses[-1], v_left, v_right, TRACK, dt))
    return np.array(poses)


PAIRS = {(0.4, 0.4): GREY, (0.35, 0.45): BLUE, (0.2, 0.4): ORANGE, (-0.1, 0.1): RED}  # v_left, v_right [m/s]
tracks = {pair: track_of(*pair) for pair in PAIRS}


def draw_until(steps):
    """The tracks up to a step."""
    figure, axis = plt.subplots(figsize=(8, 4))
    for pair, colour in PAIRS.items():
        x, y, heading = tracks[pair][:steps].T
        axis.plot(x, y, color=colour, label=f"left {pair[0]}, right {pair[1]} m/s")
        ahead = 0.2 * np.array([np.cos(heading[-1]), np.sin(heading[-1])])
        axis.plot([x[-1], x[-1] + ahead[0]], [y[-1], y[-1] + ahead[1]], color=colour, linewidth=4)
    axis.set(xlim=(-0.7, 2.8), ylim=(-0.3, 2.6), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axis.legend(loc="upper left", fontsize=8)
    return figure


if quick:
    draw_until(61)
    plt.show()
else:
    display(film([photo(draw_until(steps)) for steps in range(1, 62, 4)]))


# %% [markdown]
# ## 2. A wheel does not do what it is told
#
# A motor follows with a lag of 50 ms, and a worn one gives 80 % of what it is asked for. A *PID loop* 50 times a
# second asks for more until the wheel really turns as it should. With $e$ = target $-$ measured:
#
# $$\text{asked} = \text{target} + K_p\,e + K_i\!\int\! e\,dt + K_d\,\dot e$$
#
# The first term is *feed-forward*: a good motor needs nothing else. The integral is held in $\pm 0.2$ m, or a blocked
# wheel would save up a leap (*wind-up*).
#
# **Exercise `pid`** (medium, 10 minutes). Numbers: target, measured and the error of the last step [m/s], the integral so
# far [m]. First add $e\,dt$ to the integral and hold it in its bounds, then use it; $\dot e$ is the change of the error over
# $dt$. Return asked [m/s], the new integral [m] and this error [m/s].

# %% grade_id="pid" tags=["solution"]
def pid(target, measured, integral, last_error, dt):
    """(asked, integral, error) of one wheel, one step of dt [s]."""
    ### BEGIN SOLUTION
    error = target - measured
    integral = min(max(integral + error * dt, -MOST_INTEGRAL), MOST_INTEGRAL)
    asked = target + KP * error + KI * integral + KD * (error - last_error) / dt
    return asked, integral, error
    ### END SOLUTION


# %% grade_id="pid_check" points=3 tags=["check"]
check("pid", pid)


# %%
def wheel(loop, strength=0.8, target=0.5, seconds=2.0, dt=0.02, lag=0.05):
    """Speed of a worn wheel [m/s] over time; `loop` as `pid`."""
    speed, integral, last_error, speeds = 0.0, 0.0, 0.0, []
    for _ in range(round(seconds / dt)):
        asked, integral, last_error = loop(target, speed, integral, last_error, dt)
        speed += (1.0 - np.exp(-dt / lag)) * (strength * asked - speed)
        speeds.append(speed)
    return np.array(speeds)


LOOPS = {
    "feed-forward alone": (lambda target, *_: (target, 0.0, 0.0), GREY),
    "with P": (lambda target, measured, *_: (target + KP * (target - measured), 0.0, 0.0), ORANGE),
    "yours": (pid, BLUE),
}
figure, axis = plt.subplots(figsize=(8, 2.8))
for name, (loop, colour) in LOOPS.items():
    axis.plot(0.02 * np.arange(1, 101), wheel(loop), color=colour, label=name)
axis.axhline(0.5, color=GREEN, linewidth=1, label="target")
axis.set(xlabel="time [s]", ylabel="speed of the wheel [m/s]", title="a motor of 80 % strength")
axis.legend()
plt.show()
print(", ".join(f"{name} {wheel(loop)[-1]:.2f} m/s" for name, (loop, _) in LOOPS.items()))
# expect: feed-forward alone 0.40 m/s, with P 0.45 m/s, yours 0.50 m/s

# %% [markdown]
# P alone needs an error to ask for more, so an error stays. Only the integral can ask for more *without* one.
#
# ## 3. Watts and joules
#
# $$P = 5 + 8|v| + 20v^2 + 6|\omega| + 4\omega^2 + 15\max(0,\ v\,\dot v) \quad [\text{W}]$$
#
# Computer and lidar draw 5 W always, the motors the rest, and 15 kg want to be accelerated. Braking gives nothing back.
#
# **Exercise `power`** (easy, very important, 5 minutes). Numbers or arrays.

# %% grade_id="power" tags=["solution"]
def power(v, omega, acceleration):
    """Watts drawn at v [m/s], omega [rad/s] and acceleration dv/dt [m/s2]."""
    ### BEGIN SOLUTION
    driving = 8.0 * np.abs(v) + 20.0 * np.square(v)
    turning = 6.0 * np.abs(omega) + 4.0 * np.square(omega)
    return 5.0 + driving + turning + MASS * np.maximum(0.0, np.multiply(v, acceleration))
    ### END SOLUTION


# %% grade_id="power_check" points=2 tags=["check"]
check("power", power)

# %% [markdown]
# A watt is a joule a second, and a metre takes $1/v$ seconds. So a metre costs $P/v = 5/v + 8 + 20v$ joules. Slow
# pays the 5 W for long, fast pays the square. The derivative is zero at $v = \sqrt{5/20}$.

# %%
speed = np.linspace(0.1, 0.8, 141)  # [m/s]
joules = power(speed, 0.0, 0.0) / speed
best = int(np.argmin(joules))
figure, axis = plt.subplots(figsize=(8, 2.8))
axis.stackplot(
    speed, 5.0 / speed, np.full_like(speed, 8.0), 20.0 * speed, colors=[GREY, ORANGE, BLUE], alpha=0.6,
    labels=["being on", "rolling", "speed"],
)  # fmt: skip
axis.plot(speed, joules, color=RED)
axis.plot(speed[best], joules[best], "o", color=RED)
axis.set(xlabel="speed [m/s]", ylabel="energy [J/m]", ylim=(0, 65))
axis.legend(loc="upper right", ncols=3)
plt.show()
least = f"cheapest {speed[best]:.2f} m/s: {joules[best]:.1f} J/m"
print(f"{least}; at 0.8 m/s {joules[-1]:.1f}, at 0.1 m/s {joules[0]:.1f}")
# expect: cheapest 0.50 m/s: 28.0 J/m; at 0.8 m/s 30.3, at 0.1 m/s 60.0

# %% [markdown]
# So a robot that has a way to go and only wants to save energy does not crawl: it drives at 0.5 m/s. And a careful one
# that crawls pays twice as much for the same way.
#
# ## 4. People in the way
#
# Two planners of the library drive at up to 0.8 m/s. `astar` takes the shortest way on the map, `rrtstar` grows a
# random tree and pulls it straight. Both brake for what the scan shows close ahead, and both think that a person is a
# piece of furniture. Five people cross their way (they make room, but a robot that runs into them is a contact).

# %%
busy = load_scenario("crowd_reactive")
empty = with_overrides(busy, {"crowd": None})  # the same kind of hall without them


def seen(arm, scenario, seed, **more):
    """One run: its row for the table, and the run."""
    speeds = []
    chosen = planned(arm)

    def choose(observation, info):
        speeds.append(info["twist"][0])
        return chosen(observation, info)

    run = drive(choose, scenario, seed=seed, full_map=arm == "rrtstar", **more)
    slow = np.array(speeds) < 0.1
    stops = int(np.sum(slow[1:] & ~slow[:-1]))
    episode = run["info"]["summary"]
    row = {"arm": arm, "outcome": episode["outcome"], "stops": stops, "path_m": episode["path_m"]}
    row |= {"clearance_m": episode["min_clearance_m"], "energy_j": episode["energy_j"]}
    return row, run | {"speeds": np.array(speeds)}


row, run = seen("astar", busy, 9, every=0 if quick else 4)
if run["pictures"]:
    display(film(run["pictures"]))
figure, axis = plt.subplots(figsize=(8, 2.4))
axis.plot(0.1 * np.arange(len(run["speeds"])), run["speeds"], color=BLUE)
axis.axhline(0.1, color=RED, linewidth=1)
axis.set(xlabel="time [s]", ylabel="speed [m/s]", title=f"stop and go: {row['stops']} stops, {row['energy_j']:.0f} J")
plt.show()

# %% [markdown]
# Each start costs $\tfrac12 m v^2$ = 4.8 J on top of the way, each second of waiting 5 J, and the detours cost metres.
# Ten halls with people against ten without:

# %%
rows = [
    seen(arm, scenario, seed)[0] | {"people": people}
    for arm in ("astar", "rrtstar")
    for people, scenario in ((0, empty), (5, busy))
    for seed in range(10)
]
table = pd.DataFrame(rows)
table["arrived"] = table.outcome == "goal"
table["j_per_m"] = table.energy_j / table.path_m
summary = table.groupby(["arm", "people"])[["arrived", "stops", "clearance_m", "j_per_m"]].mean()
astar = summary.loc["astar"]
print(f"arrived of ten halls: astar {10 * astar.arrived[5]:.0f} among people, {10 * astar.arrived[0]:.0f} alone")
print(f"astar: {astar.j_per_m[0]:.0f} J/m alone, {astar.j_per_m[5]:.0f} J/m among people; stops {astar.stops[5]:.1f}")
# expect: arrived of ten halls: astar 5 among people, 10 alone
# expect: astar: 31 J/m alone, 36 J/m among people; stops 0.7
summary.round(2)

# %% [markdown]
# Without people both arrive always, and on average keep more than half a metre of room. With five people they stop and go, pay more
# for each metre, pass within centimetres, and do not always arrive: A\* runs into somebody in every second hall. The map
# says where people *are*; what a robot needs to know is where they *will be*. That is lesson 05.
#
# ## Change this one line and look
#
# - `KI = 4.0` in the second cell: try 40. The wheel overshoots. (The check of `pid` will complain.)
# - The 5 W in your `power`: 20, for a hungrier computer. Where does the cheapest speed go? (The check will complain.)
# - `planned(arm)` in part 4: `planned(arm + "@max_speed=0.5")`. Cheaper a metre, and how many arrive?
#
# Papers: Hart, Nilsson, Raphael, *A formal basis for the heuristic determination of minimum cost paths*, 1968 (A\*);
# Karaman, Frazzoli, *Sampling-based algorithms for optimal motion planning*, IJRR 2011, algorithm 6 (RRT\*); Helbing,
# Molnar, *Social force model for pedestrian dynamics*, Phys. Rev. E 1995, eqs. 3 and 4 (the people).
