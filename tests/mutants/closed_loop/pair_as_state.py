# hint: two values
def closed_loop(env, choose, seed):
    observation = env.reset(seed=seed)
    info = observation[2]
    total, steps = 0.0, 0
    while True:
        observation, reward, terminated, truncated, info = env.step(choose(observation, info))
        total, steps = total + reward, steps + 1
        if terminated or truncated:
            return {"reward": total, "steps": steps, "ended": "truncated" if truncated else "terminated"}
