"""JSBSim's F-16 in real time, at the far end of f16.port.toml: elevator in, altitude and attitude out."""

import socket
import struct
import sys
import time

import jsbsim

STEP_S = 0.01
TO = ("127.0.0.1", 9107)
# At rest relative to the stick: level at 350 knots.
BEGIN = {
    "ic/h-sl-ft": 15000,
    "ic/vc-kts": 350,
    "ic/gamma-deg": 0,
    "gear/gear-cmd-norm": 0,
}
OUT = ["position/h-sl-ft", "attitude/theta-rad", "attitude/phi-rad", "velocities/vtrue-fps"]


def begin():
    """Returns the aircraft, trimmed for level flight."""
    jsbsim.FGJSBBase().debug_lvl = 0
    aircraft = jsbsim.FGFDMExec(None)
    aircraft.load_model("f16")
    aircraft.set_dt(STEP_S)
    for name, value in BEGIN.items():
        aircraft[name] = value
    aircraft.run_ic()
    aircraft["propulsion/set-running"] = -1
    aircraft["simulation/do_simple_trim"] = 1
    return aircraft


def main():
    aircraft = begin()
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.bind(("127.0.0.1", 9106))
    wire.setblocking(False)
    print("ready", flush=True)
    count, start = 0, time.monotonic()
    while True:
        try:
            while True:
                _, elevator = struct.unpack("<Bd", wire.recv(64))
                aircraft["fcs/elevator-cmd-norm"] = elevator
        except OSError:  # nothing more has arrived
            pass
        while count * STEP_S < time.monotonic() - start:
            if not aircraft.run():
                sys.exit("JSBSim has ended the flight")
            count += 1
            values = (aircraft[name] for name in OUT)
            wire.sendto(struct.pack("<B4d", count % 256, *values), TO)
        time.sleep(STEP_S / 5)


if __name__ == "__main__":
    main()
