"""A cluster of two nodes that Slurm keeps, on one machine, for tests: `slurm.py FOLDER`.

Munge, the controller and both nodes have a process namespace of their own, whose first process is this program: they
end with it, however it ends. Their files are in the folder, which goes with them; nothing else is touched.

It writes `{"conf": PATH}` once both nodes are idle (clients find the cluster by SLURM_CONF=PATH), then obeys
lines on its standard input, and answers each with `done`; when that closes, everything ends:

    kill n1       slurmd and slurmstepd of the node; its tasks go on, and nobody knows of them
    crash n1      the node with its tasks
    kill ctld     the controller
    kill tasks    the tasks of both nodes
    start NAME    what was killed
"""

import json
import os
import random
import select
import shutil
import signal
import socket
import subprocess
import sys
import time

NODES = ["n1", "n2"]
# Below the ports that the kernel gives to whoever asks for any.
PORTS = range(20_000, 32_000)
READY_S = 90
LOOK_S = 0.1
# In the environment of a node's daemons, and in that of its tasks.
OF_NODE, TASK_OF_NODE = "HIL_TEST_NODE", "SLURMD_NODENAME"

CONF = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
AuthType=auth/munge
# Who is started again waits until its credential has expired.
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/%n
SlurmctldPidFile={folder}/ctld.pid
SlurmdPidFile={folder}/%n.pid
SlurmctldLogFile={folder}/ctld.log
SlurmdLogFile={folder}/%n.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/none
MpiDefault=none
MailProg=/bin/true
SlurmdParameters=config_overrides
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
MaxArraySize={most_tasks}
SlurmdTimeout=10
KillWait=2
CompleteWait=0
SchedulerParameters=sched_interval=1,bf_interval=1,sched_min_interval=0
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1
PartitionName=all Nodes=n1,n2 Default=YES MaxTime=60 State=UP
"""


def free_ports(count):
    """Ports that nobody listens at."""
    held = []
    while len(held) < count:
        one = socket.socket()
        try:
            one.bind(("127.0.0.1", random.choice(PORTS)))
        except OSError:
            one.close()
            continue
        held.append(one)
    ports = [one.getsockname()[1] for one in held]
    for one in held:
        one.close()
    return ports


def environment(pid):
    try:
        with open(f"/proc/{pid}/environ", "rb") as file:
            pairs = (one.partition(b"=") for one in file.read().split(b"\0"))
            return {name.decode(errors="replace"): value.decode(errors="replace") for name, _, value in pairs}
    except OSError:
        return {}  # gone, or dead


def processes(variable, node):
    """Processes with this value in their environment."""
    numbers = (int(name) for name in os.listdir("/proc") if name.isdecimal())
    return [pid for pid in numbers if environment(pid).get(variable) == node]


def reap():
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        pass


def send_kill(pid):
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass  # it has ended meanwhile


def kill(find):
    """Kills what is found until nothing is: some of it may be about to start more."""
    while pids := find():
        for pid in pids:
            send_kill(pid)
        reap()
        time.sleep(0.01)


class Cluster:
    def __init__(self, folder, most_tasks):
        self.folder, self.conf = folder, f"{folder}/slurm.conf"
        os.makedirs(f"{folder}/state")
        for name in NODES:
            os.makedirs(f"{folder}/{name}")
        host = socket.gethostname().partition(".")[0]
        settings = {"folder": folder, "host": host, "ports": free_ports(3), "most_tasks": most_tasks}
        self.write("slurm.conf", CONF.format(**settings).encode())
        self.write("cgroup.conf", b"CgroupPlugin=cgroup/v1\n")
        self.write("munge.key", os.urandom(128))
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("SLURM")}
        self.environment |= {"SLURM_CONF": self.conf, "PATH": os.environ.get("PATH", "") + ":/usr/sbin:/usr/bin:/bin"}

    def write(self, name, content):
        with open(f"{self.folder}/{name}", "xb", opener=lambda path, flags: os.open(path, flags, 0o600)) as file:
            file.write(content)

    def run(self, name, *command):
        """Starts a daemon, with all that it says in a file."""
        marked = self.environment | {OF_NODE: name}
        with open(f"{self.folder}/{name}.said", "ab") as said:
            subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=marked)

    def start(self, name):
        if name == "munge":
            files = [f"--{one}-file={self.folder}/munge.{one}" for one in ("key", "pid", "log", "seed")]
            # By force: its socket is in a folder of one user.
            self.run(name, "munged", "--foreground", "--force", f"--socket={self.folder}/munge.socket", *files)
        elif name == "ctld":
            self.run(name, "slurmctld", "-D", "-f", self.conf)
        else:
            self.run(name, "slurmd", "-D", "-N", name, "-f", self.conf)

    def states(self):
        asked = ["sinfo", "--noheader", "--Node", "--format=%T"]
        try:
            said = subprocess.run(
                asked, env=self.environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=10
            )
            return said.stdout.split()
        except subprocess.TimeoutExpired:
            return []

    def begin(self):
        self.start("munge")
        until(lambda: os.path.exists(f"{self.folder}/munge.socket"), "munged")
        for name in ["ctld"] + NODES:
            self.start(name)
        until(lambda: self.states() == ["idle"] * len(NODES), "the nodes")

    def obey(self, words):
        match words:
            case ["kill", "tasks"]:
                # Once: those that Slurm starts in their place may go on.
                for pid in [pid for node in NODES for pid in processes(TASK_OF_NODE, node)]:
                    send_kill(pid)
            case ["kill", name]:
                kill(lambda: processes(OF_NODE, name))
            case ["crash", name]:
                kill(lambda: processes(OF_NODE, name) + processes(TASK_OF_NODE, name))
            case ["start", name]:
                self.start(name)
            case _:
                return f"unknown: {words}"
        return "done"


def until(happened, what):
    end = time.monotonic() + READY_S
    while not happened():
        if time.monotonic() > end or ended():
            sys.exit(f"{what}: not ready")
        time.sleep(LOOK_S)


def ended():
    """Tells whether nobody wants the cluster any more."""
    poll = select.poll()
    poll.register(0, select.POLLHUP)
    return bool(poll.poll(0))


def serve(folder, most_tasks):
    """Is the first process of the namespace."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    try:
        cluster = Cluster(folder, most_tasks)
        cluster.begin()
        print(json.dumps({"conf": cluster.conf}), flush=True)
        while True:
            reap()
            if not select.select([0], [], [], LOOK_S)[0]:
                continue
            line = sys.stdin.readline()
            if not line:
                return
            print(cluster.obey(line.split()), flush=True)
    except SystemExit as refused:
        if isinstance(refused.code, str):
            tell_logs(folder)
        raise
    finally:
        kill(lambda: [int(name) for name in os.listdir("/proc") if name.isdecimal() and int(name) != 1])
        shutil.rmtree(folder, ignore_errors=True)


def tell_logs(folder):
    """Repeats the end of what each daemon said."""
    for name in sorted(os.listdir(folder)):
        if name.endswith((".said", ".log")):
            with open(f"{folder}/{name}", errors="replace") as file:
                print(f"-- {name}\n{''.join(file.readlines()[-8:])}", file=sys.stderr)


def main():
    folder, most_tasks = os.path.abspath(sys.argv[1]), (sys.argv[2:] or ["1001"])[0]
    if sys.argv[3:] == ["inside"]:
        return serve(folder, most_tasks)
    own = [sys.executable, os.path.abspath(__file__), folder, most_tasks, "inside"]
    os.execvp("unshare", ["unshare", "--pid", "--mount-proc", "--fork", "--kill-child"] + own)


if __name__ == "__main__":
    main()
