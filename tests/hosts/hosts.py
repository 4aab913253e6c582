"""Two hosts and the wire between them, on one machine, for tests: `hosts.py FOLDER`.

The desk is a network namespace; the board has namespaces for network, mounts and processes, a /dev/shm of its own and an
sshd. This program is the wire: it copies Ethernet frames from one to the other, and spoils datagrams as it is told.

It writes `ready DESK BOARD` (process numbers to enter the namespaces by), then obeys lines on its standard input,
and answers each with `done`; when that closes, everything ends:

    spoil PERCENT SEED   of the datagrams, so many percent each are lost, doubled, held back and changed by one bit
    cut                  nothing gets through
    mend                 everything gets through again
    block                no datagram gets through
    intrude              after each datagram come an old one, one sent back to who sent it, a shorter one and garbage
    burst COUNT          the next so many datagrams of the board are lost
    counts               answers with `counts PASSED LOST DOUBLED HELD CHANGED`
"""

import ctypes
import fcntl
import os
import random
import select
import signal
import socket
import struct
import subprocess
import sys
import time

DESK, BOARD = "10.77.0.1", "10.77.0.2"
SIOCETHTOOL, ETHTOOL_STXCSUM = 0x8946, 0x17
OUTGOING = 4


def fill_check_sums(interface):
    """Has the kernel fill in checksums that it would leave to hardware: the wire is not hardware."""
    value = (ctypes.c_uint32 * 2)(ETHTOOL_STXCSUM, 0)
    request = struct.pack("16sP", interface.encode(), ctypes.addressof(value))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, SIOCETHTOOL, request)


def host(interface, address):
    """Becomes a host once its end of the wire is there."""
    while subprocess.run(["ip", "link", "show", interface], capture_output=True).returncode:
        time.sleep(0.01)
    fill_check_sums(interface)
    for command in (
        f"ip link set lo up",
        f"ip addr add {address}/24 dev {interface}",
        f"ip link set {interface} up",
    ):
        subprocess.run(command.split(), check=True)


def board(folder):
    subprocess.run("mount --make-rprivate /".split(), check=True)
    subprocess.run("mount -t proc proc /proc".split(), check=True)
    subprocess.run("mount -t tmpfs -o mode=1777 tmpfs /dev/shm".split(), check=True)
    os.makedirs("/run/sshd", exist_ok=True)
    host("board", BOARD)
    os.execv("/usr/sbin/sshd", ["/usr/sbin/sshd", "-D", "-f", f"{folder}/sshd_config", "-E", f"{folder}/sshd.log"])


def desk():
    host("desk", DESK)
    signal.pause()


class Wire:
    def __init__(self, desk_end, board_end):
        self.ends = {desk_end.fileno(): (desk_end, board_end), board_end.fileno(): (board_end, desk_end)}
        self.board = board_end
        self.percent, self.random = 0, random.Random(0)
        self.is_cut, self.is_blocked, self.burst = False, False, 0
        self.held = []
        self.is_intruded, self.old = False, []
        self.counts = {"passed": 0, "lost": 0, "doubled": 0, "held": 0, "changed": 0, "answers": 0}

    def hits(self):
        return self.random.uniform(0, 100) < self.percent

    def pass_on(self, number):
        end, other = self.ends[number]
        frame, address = end.recvfrom(65536)
        if address[2] == OUTGOING or self.is_cut:
            return
        is_datagram = frame[12:14] == b"\x08\x00" and frame[23] == socket.IPPROTO_UDP
        if not is_datagram:
            return self.send(other, frame)
        if self.is_blocked:
            return None
        if end is self.board and self.burst > 0:
            self.burst -= 1
            self.counts["lost"] += 1
            return None
        if self.hits():
            self.counts["lost"] += 1
            return None
        if self.hits():
            frame = self.changed(frame)
        if self.hits():
            self.counts["doubled"] += 1
            self.send(other, frame)
        if self.hits():
            self.counts["held"] += 1
            self.held.append((time.monotonic() + self.random.uniform(0, 0.01), other, frame))
            return None
        self.counts["passed"] += 1
        self.counts["answers"] += end is self.board
        self.send(other, frame)
        if self.is_intruded:
            self.intrude(end, other, frame)
        return None

    def changed(self, frame):
        """Inverts a bit of the content, and takes away the checksum of UDP, which would hide it from the other end."""
        self.counts["changed"] += 1
        frame = bytearray(frame)
        content = 14 + 4 * (frame[14] & 15) + 8
        frame[content - 2 : content] = b"\0\0"
        length = len(frame) - content
        place = content + self.random.randrange(length)
        frame[place] ^= 1 << self.random.randrange(8)
        return bytes(frame)

    def intrude(self, end, other, frame):
        """Sends what somebody on the wire could make of what passes there."""
        if len(self.old) < 1000:
            self.old.append((other, frame))
        old_end, old = self.random.choice(self.old)
        self.send(old_end, old)
        back = frame[6:12] + frame[:6] + frame[12:26] + frame[30:34] + frame[26:30]
        back += frame[36:38] + frame[34:36] + frame[38:40] + b"\0\0" + frame[42:]
        self.send(end, back)
        for content in (frame[42 : 42 + self.random.randrange(len(frame) - 42)], self.random.randbytes(400)):
            self.send(other, datagram(frame, content))

    def send(self, end, frame):
        try:
            end.send(frame)
        except OSError:
            pass  # a full queue loses it, as any may be

    def release(self):
        now = time.monotonic()
        due = [one for one in self.held if one[0] <= now]
        self.held = [one for one in self.held if one[0] > now]
        for _, end, frame in due:
            if not self.is_cut:
                self.send(end, frame)

    def obey(self, words):
        match words:
            case ["spoil", percent, seed]:
                self.percent, self.random = float(percent), random.Random(int(seed))
            case ["cut"]:
                self.is_cut = True
            case ["mend"]:
                self.is_cut = self.is_blocked = False
            case ["intrude"]:
                self.is_intruded = True
            case ["block"]:
                self.is_blocked = True
            case ["burst", count]:
                self.burst = int(count)
            case ["counts"]:
                return "counts " + " ".join(str(count) for count in self.counts.values())
        return "done"


def datagram(frame, content):
    """A frame with the addresses and ports of another, and this content."""
    udp = frame[34:38] + struct.pack("!HH", 8 + len(content), 0)
    header = bytearray(frame[14:34])
    header[2:4] = struct.pack("!H", 28 + len(content))
    header[10:12] = b"\0\0"
    total = sum(struct.unpack("!10H", header))
    total = (total & 0xFFFF) + (total >> 16)
    header[10:12] = struct.pack("!H", ~((total & 0xFFFF) + (total >> 16)) & 0xFFFF)
    return frame[:14] + bytes(header) + udp + content


def raw(interface):
    end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
    end.bind((interface, 0))
    return end


def wire(folder):
    own = [sys.executable, os.path.abspath(__file__)]
    desk_host = subprocess.Popen(["unshare", "--net"] + own + [folder, "desk"], stdin=subprocess.DEVNULL)
    board_host = subprocess.Popen(
        ["unshare", "--net", "--mount", "--pid", "--fork", "--kill-child"] + own + [folder, "board"],
        stdin=subprocess.DEVNULL,
    )
    hosts = [desk_host, board_host]
    try:
        inside = None
        while inside is None:  # the child of `unshare` is in the new namespaces
            with open(f"/proc/{board_host.pid}/task/{board_host.pid}/children") as children:
                inside = next(iter(children.read().split()), None)
            time.sleep(0.01)
        for name, pid in (("desk", desk_host.pid), ("board", inside)):
            own_net = os.readlink("/proc/self/ns/net")
            while os.readlink(f"/proc/{pid}/ns/net") == own_net:
                time.sleep(0.01)
            subprocess.run(f"ip link add to_{name} type veth peer name {name} netns {pid}".split(), check=True)
            subprocess.run(f"ip link set to_{name} up".split(), check=True)
        ends = Wire(raw("to_desk"), raw("to_board"))
        while not answers(ends, desk_host.pid):
            pass
        print("ready", desk_host.pid, inside, flush=True)
        serve(ends)
    finally:
        for one in hosts:
            one.kill()
            one.wait()


def answers(ends, pid):
    """Passes frames on until the board's sshd greets the desk."""
    asking = subprocess.Popen(
        f"nsenter -t {pid} -n ssh-keyscan -T 2 {BOARD}".split(), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    while asking.poll() is None:
        step(ends, [])
    return bool(asking.stdout.read())


def step(ends, others):
    ready, _, _ = select.select(list(ends.ends) + others, [], [], 0.001 if ends.held else 0.05)
    ends.release()
    for one in ready:
        if one in ends.ends:
            ends.pass_on(one)
    return [one for one in ready if one not in ends.ends]


def serve(ends):
    while True:
        if step(ends, [0]):
            line = sys.stdin.readline()
            if not line:
                return
            print(ends.obey(line.split()), flush=True)


def main():
    folder = sys.argv[1]
    match sys.argv[2:]:
        case ["board"]:
            board(folder)
        case ["desk"]:
            desk()
        case ["wire"]:
            signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
            wire(folder)
        case _:
            os.execvp("unshare", ["unshare", "--net", sys.executable, os.path.abspath(__file__), folder, "wire"])


if __name__ == "__main__":
    main()
