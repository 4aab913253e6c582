"""Random faults on the plants that ship, from a seeded generator."""

#: Largest size of a value by its unit; others are drawn from their own range.
BOUNDS = {
    "N": 2.0,
    "m": 1e-3,
    "rad": 3.0,
    "Pa": 1e6,
    "1/s": 10.0,
    "N m": 100.0,
    "N s/m": 1e4,
    "Pa s/m3": 1e9,
    "m3/s/sqrt(Pa)": 5e-7,
    "Hz": 50.0,
    "s": 0.2,
    "steps": 20,
}
#: Kinds without random values here: tables of rows, a network that the scenarios lack, and time on the clock.
OTHERS = ("cross-coupling", "babble", "late")


def value(random, field, size):
    """Draws a value of a parameter; `size` is that of the signal that the fault acts on."""
    name, unit = field["name"], field["unit"]
    if name == "factor":
        return random.uniform(0.4, 0.95)
    if unit.startswith("target"):
        return size * random.uniform(0.1, 1)
    bound = BOUNDS.get(unit, 3.0)
    low, high = max(float(field["min"]), -bound), min(float(field["max"]), bound)
    if unit == "steps" or name in ("bits", "burst"):
        return random.randint(max(int(low), 1), int(high))
    return random.uniform(low, high)


def fault(random, possible, size):
    """Draws a fault: its kind, its target as a scenario names it, and its values."""
    plant = possible["plant"]
    kinds = [(kind, True) for kind in plant["faults"]]
    kinds += [(kind, False) for kind in possible["kinds"] if kind["kind"] not in OTHERS]
    kind, is_own = random.choice(kinds)
    if is_own:
        target = {kind["selector"]: random.randint(1, 2)} if kind["selector"] else {}
        fields = kind["sizes"] + ([kind["profile"]["speed"]] if "speed" in kind["profile"] else [])
    else:
        signals = [f"measured.{field['name']}" for field in plant["measured"]]
        signals += [f"reference.{field['name']}" for field in possible["reference"]]
        signals += [f"command.{field['name']}" for field in plant["commands"]]
        names = {"links": ["link.sample", "link.command"], "controller": ["controller"]}
        target = {"target": random.choice(names.get(kind["acts_on"], signals))}
        fields = kind["parameters"]
    values = {field["name"]: value(random, field, size) for field in fields}
    if kind["kind"] == "saturation":
        values["min"] = -values["max"]
    return kind["kind"], target, values


def event(random, possible, size, duration_s):
    """Draws a fault of a scenario."""
    kind, target, values = fault(random, possible, size)
    drawn = {"kind": kind, "at_s": round(random.uniform(0, 0.8 * duration_s), 4), "effects": [{**target, **values}]}
    if random.random() < 0.5:
        drawn["duration_s"] = round(random.uniform(0.05, 0.4) * duration_s, 4)
    return drawn
