"""Makes the calls of recorded runs of FMUs anew, by FMPy's low-level interface, and compares every number.

    python compare_fmu.py MODEL.fmu RUN RATE_HZ [MODEL.fmu RUN RATE_HZ]..

Inputs are the recorded commands as they were applied, outputs are compared with the recorded measured signals, bit
by bit but for the sign of zero and the bits of NaN, which a recording does not keep. Columns are matched with
variables by their order, so nothing here knows how names are spelled. Prints a line for each run; ends with 0 when
all is the same.
"""

import pathlib
import shutil
import sys
import tomllib

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools" / "python"))

import hil

TWO = {"Real": "Real", "Integer": "Integer", "Enumeration": "Integer", "Boolean": "Boolean"}
THREE = {
    **{f"Float{bits}": f"Float{bits}" for bits in (32, 64)},
    **{f"{sign}Int{bits}": f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)},
    "Enumeration": "Int64",
    "Boolean": "Boolean",
}


def elements(variable, sizes):
    count = 1
    for dimension in variable.dimensions or []:
        count *= int(dimension.start) if dimension.start is not None else sizes[dimension.variable.valueReference]
    return count


def canonical(values):
    values = np.asarray(values, dtype=np.float64) + 0.0
    values[np.isnan(values)] = np.nan
    return values.view(np.uint64)


class Calls:
    """An FMU and its variables by role."""

    def __init__(self, path, plant):
        self.structural = plant.get("structural", {})
        self.given = plant.get("parameters", {})
        self.model = model = fmpy.read_model_description(path, validate=False)
        # As FMPy's `simulate_fmu` takes them, where the scenario has none.
        experiment = lambda name: getattr(model.defaultExperiment, name, None)
        number = lambda text: None if text is None else float(text)
        self.tolerance = number(plant.get("tolerance", experiment("tolerance")))
        self.start_s = number(plant.get("start_time_s", experiment("startTime"))) or 0.0
        self.folder = fmpy.extract(path)
        self.kinds = TWO if model.fmiVersion.startswith("2") else THREE
        slave = FMU2Slave if self.kinds is TWO else FMU3Slave
        self.fmu = slave(
            guid=model.guid,
            unzipDirectory=self.folder,
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=model.modelName,
        )
        known = [one for one in model.modelVariables if one.type in self.kinds and one.alias is None]
        sizes = [one for one in known if one.causality == "structuralParameter" and "Int" in one.type]
        # Several names may be those of one size.
        self.sizes = {one.valueReference: int(one.start) for one in sizes}
        self.sizes |= {one.valueReference: self.structural[one.name] for one in sizes if one.name in self.structural}
        self.inputs, self.outputs, self.parameters = (
            [one for one in known if one.causality == role] for role in ("input", "output", "parameter")
        )

    def set(self, variables, values):
        values = list(values)
        for one in variables:
            count = elements(one, self.sizes)
            own, values = values[:count], values[count:]
            is_float = one.type.startswith("Float") or one.type == "Real"
            own = [float(value) if is_float else int(value) for value in own]
            getattr(self.fmu, f"set{self.kinds[one.type]}")([one.valueReference], own)
        assert not values

    def get(self):
        row = []
        for one in self.outputs:
            get = getattr(self.fmu, f"get{self.kinds[one.type]}")
            if self.kinds is TWO:
                row += get([one.valueReference])
            else:
                row += get([one.valueReference], nValues=elements(one, self.sizes))
        return row

    def start(self):
        self.fmu.instantiate()
        if self.structural:
            self.fmu.enterConfigurationMode()
            known = {one.name: one for one in self.model.modelVariables}
            for name, value in self.structural.items():
                self.set([known[name]], [value])
            self.fmu.exitConfigurationMode()
            self.set(self.parameters, self.given.values())
        for one in [] if self.structural else self.parameters:
            words = str(one.start).split()
            words = [{"true": 1, "false": 0}.get(word, word) for word in words]
            self.set([one], map(float, words))
        if self.kinds is TWO:
            self.fmu.setupExperiment(tolerance=self.tolerance, startTime=self.start_s)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(tolerance=self.tolerance, startTime=self.start_s)
        self.fmu.exitInitializationMode()

    def end(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)


def compare(path, run_path, rate_hz):
    rate_hz = float(rate_hz)
    data = hil.open(run_path).to_numpy()
    columns = lambda kind: [values for name, values in data.items() if name.startswith(kind + ".")]
    applied, measured = columns("applied"), columns("measured")
    scenario = tomllib.loads((pathlib.Path(run_path) / "scenario.toml").read_text())
    calls = Calls(path, scenario["plant"])
    calls.start()
    rows = [calls.get()]
    for step in range(len(data["step"]) - 1 if "step" in data else len(measured[0]) - 1):
        calls.set(calls.inputs, [command[step] for command in applied])
        calls.fmu.doStep(calls.start_s + step / rate_hz, 1 / rate_hz)
        rows.append(calls.get())
    calls.end()
    rows = np.asarray(rows, dtype=np.float64).T
    assert len(rows) == len(measured), f"{len(rows)} outputs and {len(measured)} measured signals"
    differing = sum(int((canonical(ours) != canonical(theirs)).sum()) for ours, theirs in zip(measured, rows))
    moved = sum(len(set(canonical(row))) > 1 for row in rows)
    print(f"{differing} of {rows.size} numbers differ, {moved} of {len(rows)} outputs move")
    return differing


if __name__ == "__main__":
    words = sys.argv[1:]
    differing = [compare(*words[at : at + 3]) for at in range(0, len(words), 3)]
    sys.exit(1 if any(differing) else 0)
