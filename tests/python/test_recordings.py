"""The package `hil` on recordings made here, with the public writer and a closed form.

    python -m unittest test_recordings
"""

import json
import math
import pathlib
import struct
import sys
import tempfile
import unittest

import lz4.block
import lz4.frame
import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools" / "python"))

import hil
from hil import chunks, recording
from hil.native import native

SCHEMA = """uint64 step
uint64[2] sample_invalid
hil_msgs/Truth truth
hil_msgs/Command command
uint64 time_ns
uint64 round_trip_ns
================================================================================
MSG: hil_msgs/Truth
float64 angle_rad # [rad] The angle.
float64 ratio # No unit.
================================================================================
MSG: hil_msgs/Command
float64 force_n # [N] The [last] force.
"""
RATE_HZ = 1000.0
STEPS = 3000
# In the middle of records, as in a run.
FAULT = {"event": "fault", "kind": "bias", "target": "truth.angle_rad", "step": 1234}
END = {"event": "end", "steps": STEPS}


def angle_rad(step):
    return math.sin(0.01 * step)


def words(step):
    force_n = math.nan if step == STEPS else -2.0 * step
    numbers = np.array([angle_rad(step), step / 7.0, force_n])
    time_ns = step * 10**6
    counts = np.array([step, 0, 0], "<u8"), np.array([time_ns, 5000 + step], "<u8")
    return counts[0].tobytes() + numbers.tobytes() + counts[1].tobytes()


EVENT = """string json # All facts.
string event
uint64 step
"""


def text(words):
    return (len(words) + 1).to_bytes(4, "little") + words.encode() + b"\0"


def event(facts):
    """As CDR: texts with a length and a zero, at multiples of 4; numbers at multiples of 8."""
    message = text(json.dumps(facts))
    message += bytes(-len(message) % 4) + text(facts["event"])
    message += bytes(-len(message) % 8) + facts.get("step", 0).to_bytes(8, "little")
    return b"\0\1\0\0" + message


def write(path, compression=CompressionType.LZ4, steps=range(STEPS + 1), earlier=False, indices=IndexType.ALL):
    with open(path, "wb") as file:
        writer = Writer(file, compression=compression, chunk_size=20_000, index_types=indices)
        writer.start("ros2")
        writer.add_metadata("hil.run", {"rate_hz": "1000", "scenario": "made here"})
        writer.add_attachment(0, 0, "scenario.toml", "application/toml", b"schema = 1\n")
        schema = writer.register_schema("hil_msgs/msg/Record", "ros2msg", SCHEMA.encode())
        records = writer.register_channel("/record", "cdr", schema)
        if earlier:
            schema = writer.register_schema("hil.Event", "jsonschema", b"{}")
            events = writer.register_channel("/events", "json", schema)
        else:
            schema = writer.register_schema("hil_msgs/msg/Event", "ros2msg", EVENT.encode())
            events = writer.register_channel("/events", "cdr", schema)

        def message(facts):
            return json.dumps(facts).encode() if earlier else event(facts)

        time_ns = 0
        for step in steps:
            time_ns = step * 10**6
            if step == FAULT["step"]:
                writer.add_message(events, time_ns, message(FAULT), time_ns)
            writer.add_message(records, time_ns, b"\0\1\0\0" + words(step), time_ns)
        writer.add_message(events, time_ns, message(END), time_ns)
        writer.add_metadata("hil.result", {"digest": "abc", "records": str(STEPS + 1)})
        writer.finish()


class Recordings(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.path = self.folder / "run.mcap"
        write(self.path)

    def steps(self, **choice):
        return hil.open(self.folder).to_numpy("truth.angle_rad", **choice)["step"].tolist()

    def test_words_in_parts_are_columns_as_whole_ones_are(self):
        schema = f"""uint64 step
uint32[4] sample_invalid
hil_msgs/Surroundings plant_surroundings
{recording.RULER}
MSG: hil_msgs/Surroundings
uint8[3] page_faults # Of the thread so far.
uint8[3] context_switches
uint16 core
"""
        names = [column.name for column in recording.columns_of(schema)]
        self.assertEqual(names, ["step", "sample_invalid[0]", "sample_invalid[1]", "plant_surroundings"])

    def test_signals_have_their_values_and_units(self):
        for compression in CompressionType:
            write(self.path, compression)
            run = hil.open(self.folder)
            units = {"truth.angle_rad": "rad", "truth.ratio": "", "command.force_n": "N"}
            self.assertEqual(dict(run.signals), units)
            data = run.to_numpy()
            self.assertEqual(list(data), ["step", "time_s", *units])
            self.assertEqual(data["step"].tolist(), list(range(STEPS + 1)))
            self.assertEqual(data["time_s"].tolist(), [step / RATE_HZ for step in range(STEPS + 1)])
            self.assertEqual(data["truth.angle_rad"].tolist(), [angle_rad(step) for step in range(STEPS + 1)])
            self.assertEqual(data["truth.ratio"].tolist(), [step / 7.0 for step in range(STEPS + 1)])
            self.assertEqual(data["command.force_n"][:-1].tolist(), [-2.0 * step for step in range(STEPS)])
            self.assertTrue(math.isnan(data["command.force_n"][-1]))

    def test_a_recording_without_indices_has_the_same_values(self):
        names = ["command.force_n", "truth.*", "round_trip_ns"]
        indexed = hil.open(self.folder).to_numpy(names)
        write(self.path, indices=IndexType.NONE)
        plain = hil.open(self.folder).to_numpy(names)
        self.assertEqual(list(indexed), list(plain))
        for name, values in indexed.items():
            self.assertEqual(values.tobytes(), plain[name].tobytes(), name)

    def test_an_index_that_does_not_match_its_chunk_is_refused(self):
        content = bytearray(self.path.read_bytes())
        try:
            native()
        except hil.ProgramError:
            self.skipTest("the native part is missing, which alone uses indices")
        # Opcode, length, channel of the records, and the length of the list.
        counts = [place.records for place in recording.Recording(self.path)._chunks]
        index = struct.pack("<BQHI", 7, 6 + 16 * counts[3], 1, 16 * counts[3])
        self.assertIn(index, content)
        place = content.index(index) + len(index) - 4
        # One record less, and more than any file of this size has.
        for length in (16 * (counts[3] - 1), 2**32 - 1):
            content[place : place + 4] = struct.pack("<I", length)
            self.path.write_bytes(content)
            most = sum(place.records for place in recording.Recording(self.path)._chunks)
            self.assertLessEqual(most, len(content) // 16)
            with self.assertRaisesRegex(hil.RecordingError, "an index does not match its chunk"):
                hil.open(self.path).to_numpy()

    def test_a_window_has_both_its_ends_and_picking_begins_at_the_first(self):
        self.assertEqual(self.steps(window_s=(0.5, 0.503)), [500, 501, 502, 503])
        self.assertEqual(self.steps(window_s=(0.5001, 0.5029)), [501, 502])
        self.assertEqual(self.steps(window_s=(2.999, 9.0)), [2999, 3000])
        self.assertEqual(self.steps(every=1000), [0, 1000, 2000, 3000])
        self.assertEqual(self.steps(window_s=(0.003, 0.023), every=10), [3, 13, 23])
        self.assertEqual(self.steps(window_s=(7.0, 8.0)), [])
        with self.assertRaisesRegex(ValueError, "at least 1"):
            self.steps(every=0)

    def test_lost_records_leave_the_others_where_they_are(self):
        write(self.path, steps=[*range(500), *range(777, STEPS + 1)])
        self.assertEqual(self.steps(every=250), [0, 250, *range(1000, STEPS + 1, 250)])

    def test_signals_are_chosen_by_name_and_by_pattern_in_the_order_asked_for(self):
        run = hil.open(self.path)
        chosen = run.to_numpy(["command.force_n", "truth.*", "*.angle_rad", "round_trip_ns"])
        names = ["step", "time_s", "command.force_n", "truth.angle_rad", "truth.ratio", "round_trip_ns"]
        self.assertEqual(list(chosen), names)
        self.assertEqual((chosen["round_trip_ns"].dtype, chosen["round_trip_ns"][7]), (np.uint64, 5007))
        with self.assertRaisesRegex(LookupError, "no signal `truth.angel_rad`; nearest: truth.angle_rad"):
            run.to_numpy("truth.angel_rad")

    def test_events_and_what_is_written_about_the_run_are_there(self):
        (self.folder / "summary.json").write_text('{"verdict": "pass"}')
        for earlier in (True, False):
            write(self.path, earlier=earlier)
            run = hil.open(self.folder)
            self.assertEqual((run.events, run.faults), ([FAULT, END], [FAULT]))
        self.assertEqual((run.metadata["hil.run"]["scenario"], run.digest), ("made here", "abc"))
        self.assertEqual((run.scenario, run.summary), ("schema = 1\n", {"verdict": "pass"}))
        self.assertTrue(run.is_whole)

    def test_a_cut_file_is_read_as_far_as_it_goes(self):
        content = self.path.read_bytes()
        longest = 0
        for part in range(1, 20):
            self.path.write_bytes(content[: len(content) * part // 20])
            try:
                run = hil.open(self.path)
            except hil.RecordingError as error:
                self.assertEqual(longest, 0, error)  # not even the channels are there
                continue
            ratio = run.to_numpy("truth.ratio")["truth.ratio"].tolist()
            self.assertEqual(ratio, [step / 7.0 for step in range(len(ratio))])
            self.assertGreaterEqual(len(ratio), longest)
            longest = len(ratio)
        self.assertTrue(0 < longest <= STEPS + 1, longest)

    def test_a_damaged_file_is_refused_not_misread(self):
        write(self.path, CompressionType.NONE)
        content = bytearray(self.path.read_bytes())
        place = content.index(words(1000))
        content[place + 30] ^= 1
        self.path.write_bytes(content)
        run = hil.open(self.path)
        self.assertEqual(len(run.to_numpy(window_s=(2.0, 3.0))["step"]), 1001, "the rest is whole")
        with self.assertRaisesRegex(hil.RecordingError, "damaged"):
            run.to_numpy()

    def test_what_is_no_recording_is_named(self):
        with tempfile.TemporaryDirectory() as empty:
            with self.assertRaisesRegex(hil.RecordingError, "has no recording"):
                hil.open(empty)
        self.path.write_text("not an MCAP file")
        with self.assertRaisesRegex(hil.RecordingError, "no MCAP file"):
            hil.open(self.path)

    def test_a_file_that_was_cut_before_its_first_record_is_called_cut(self):
        content = self.path.read_bytes()
        for length in (0, 5, 8, 60):
            self.path.write_bytes(content[:length])
            with self.assertRaisesRegex(hil.RecordingError, "was cut off before its first record"):
                hil.open(self.path)

    def test_a_frame_has_the_same_numbers_over_time(self):
        try:
            import pandas  # noqa: F401
        except ImportError:
            self.skipTest("pandas is missing")
        run = hil.open(self.folder)
        frame, data = run.to_pandas("truth.*", every=10), run.to_numpy("truth.*", every=10)
        self.assertEqual(list(frame.columns), ["step", "truth.angle_rad", "truth.ratio"])
        self.assertEqual(frame.index.tolist(), data["time_s"].tolist())
        for name in frame.columns:
            self.assertEqual(frame[name].tolist(), data[name].tolist())
        self.assertEqual(frame.attrs["units"], {"truth.angle_rad": "rad", "truth.ratio": ""})


class Frames(unittest.TestCase):
    """Chunks as `hil` packs them: a frame of one block, which is unpacked at once."""

    def setUp(self):
        self.content = b"".join(struct.pack("<Qd", step, math.sin(step)) * 3 for step in range(500))
        block = lz4.block.compress(self.content, store_size=False)
        self.frame = chunks.FRAME_HEAD + struct.pack("<I", len(block)) + block + chunks.FRAME_END

    def unpack(self, frame, length):
        return chunks.unpack(b"lz4", memoryview(frame), length)

    def test_the_content_is_that_of_the_library_for_frames(self):
        self.assertEqual(lz4.frame.decompress(self.frame), self.content)
        self.assertIsNotNone(chunks.only_block(memoryview(self.frame)))
        self.assertEqual(self.unpack(self.frame, len(self.content)), self.content)
        other = lz4.frame.compress(self.content, content_checksum=True)
        self.assertIsNone(chunks.only_block(memoryview(other)))
        self.assertEqual(self.unpack(other, len(self.content)), self.content)

    def test_damage_is_an_error_whatever_it_is(self):
        for cut in (0, 5, 11, 15, len(self.frame) - 9, len(self.frame) - 1):
            with self.assertRaises(chunks.ChunkError):
                self.unpack(self.frame[:cut], len(self.content))
        block = self.frame[11:-4]
        with self.assertRaises(chunks.ChunkError):
            self.unpack(self.frame[:7] + struct.pack("<I", len(block) - 5) + block[:-5] + bytes(4), len(self.content))
        with self.assertRaises(chunks.ChunkError):
            self.unpack(self.frame, len(self.content) - 1)
        # An impossible length takes no memory.
        self.assertEqual(self.unpack(self.frame, 1 << 40), self.content)


if __name__ == "__main__":
    unittest.main()
