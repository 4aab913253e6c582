#!/usr/bin/env python3
"""Starts Betaflight's simulator build (SITL) with the settings that the example needs.

BETAFLIGHT_SITL is the path of the program, which get-betaflight.sh builds. The first start saves the
settings by the command line of Betaflight; later starts reuse them. This process then becomes the SITL.
"""

import hashlib
import os
import pathlib
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time

SETTINGS = [
    # Arm by the first auxiliary channel, fly in angle mode by the second.
    "aux 0 0 0 1700 2100 0 0",
    "aux 1 1 1 1700 2100 0 0",
    # One run of the control loop for each state.
    "set gyro_hardware_lpf = NORMAL",
    "set pid_process_denom = 1",
]
COMMAND_LINE = ("127.0.0.1", 5761)
STATE = ("127.0.0.1", 9003)
LIMIT_S = 60.0


class CommandLine:
    """Betaflight's command line, which answers only while states arrive."""

    def __init__(self, sitl):
        self.sitl, self.begin = sitl, time.monotonic()
        self.states = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line = None
        while self.line is None:
            self.check()
            try:
                self.line = socket.create_connection(COMMAND_LINE, timeout=1)
            except OSError:
                time.sleep(0.02)
        # Without a newline, which would cancel it.
        self.ask(b"#", b"# ")

    def check(self):
        if self.sitl.poll() is not None:
            sys.exit(f"the SITL ended with code {self.sitl.returncode} before its settings were saved")
        if time.monotonic() - self.begin > LIMIT_S:
            sys.exit(f"the SITL took longer than {LIMIT_S:.0f} s to save its settings")

    def ask(self, text, end):
        """Sends a text and returns the answer up to `end`, or up to the end of the connection."""
        self.line.sendall(text)
        answer = b""
        while end not in answer:
            self.check()
            time_s = time.monotonic() - self.begin
            state = struct.pack("<18d", time_s, 0, 0, 0, 0, 0, -9.80665, 1, *[0] * 9, 101325)
            self.states.sendto(state, STATE)
            if select.select([self.line], [], [], 0.001)[0]:
                part = self.line.recv(4096)
                if not part:
                    break
                answer += part
        return answer


def save_settings(program, folder):
    """Lets Betaflight write its settings to `eeprom.bin` in a folder."""
    with open(folder / "settings.log", "wb") as log:
        sitl = subprocess.Popen([program], cwd=folder, stdout=log, stderr=log)
        try:
            line = CommandLine(sitl)
            for setting in SETTINGS:
                answer = line.ask(setting.encode() + b"\n", b"\n# ")
                if b"ERROR" in answer or b"INVALID" in answer:
                    sys.exit(f"Betaflight refused `{setting}`: {answer.decode(errors='replace')}")
            line.ask(b"save\n", b"Rebooting")
            sitl.wait(timeout=10)
        finally:
            sitl.kill()
            sitl.wait()


def main():
    program = os.environ.get("BETAFLIGHT_SITL")
    if not program or not os.access(program, os.X_OK):
        script = pathlib.Path(__file__).resolve().with_name("get-betaflight.sh")
        sys.exit(f"set BETAFLIGHT_SITL to Betaflight's SITL; `sh '{script}' FOLDER` builds it")
    program = os.path.abspath(program)
    identity = hashlib.sha256(pathlib.Path(program).read_bytes() + "\n".join(SETTINGS).encode())
    cache = os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache"
    cache = pathlib.Path(cache, "hil-quad")
    folder = cache / identity.hexdigest()[:16]
    if not folder.exists():
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        cache.mkdir(parents=True, exist_ok=True)
        part = pathlib.Path(tempfile.mkdtemp(dir=cache))
        try:
            save_settings(program, part)
            try:
                part.rename(folder)
            except OSError:
                if not folder.exists():
                    raise
        finally:
            shutil.rmtree(part, ignore_errors=True)
    os.chdir(folder)
    os.execv(program, [program])


if __name__ == "__main__":
    main()
