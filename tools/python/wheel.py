"""Names the platform of a wheel that contains programs.

`build` computes the tag from the programs and hands it over; a package without programs runs everywhere.
"""

import os
import pathlib

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Hook(BuildHookInterface):
    def initialize(self, version, build_data):
        if not (pathlib.Path(self.root) / "hil" / "bin" / "hil").exists():
            return
        # No extension module is in it, so any Python 3 will do.
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{os.environ['HIL_WHEEL_PLATFORM']}"
