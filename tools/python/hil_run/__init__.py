"""Recorded runs of hil as numpy arrays and pandas frames.

    import hil_run

    run = hil_run.load("runs/demo")
    data = run.to_numpy(["truth.surface_angle_rad", "command.*"], window_s=(7, 8))
    frame = run.to_pandas(["truth.*"], every=10)

Reads `run.mcap` itself, with the public MCAP library. Values are the recorded ones, bit for bit.
"""

from .recording import RecordingError
from .run import Run, load

__all__ = ["RecordingError", "Run", "load"]
