"""Names the interface and the platform of a wheel that contains programs and the native module.

`build` computes the tag from the programs and hands it over; a package without programs runs everywhere.
"""

import os
import pathlib

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Hook(BuildHookInterface):
    def initialize(self, version, build_data):
        if not (pathlib.Path(self.root) / "hil" / "bin" / "hil").exists():
            return
        # Its extension module uses the stable interface of CPython 3.9.
        build_data["pure_python"] = False
        build_data["tag"] = f"cp39-abi3-{os.environ['HIL_WHEEL_PLATFORM']}"
