"use strict";
// The part of a run at which a page looks closer: it asks its server for the part in sight and keeps the answer, which
// has every step where there is room for it, or else the least and the greatest value of equal stretches.

// `ask` sends a message, `changed` follows each answer; a lens over the other run asks for that one.
const lensOf = ({ ask, changed, over = false }) => {
  let data = new Map();
  let turn = 0;
  let span = null;
  let most = 0;
  let places = [];
  let isAsking = false;
  // Signals of the last request, and the request that each was last asked in: not every run has each of them.
  let asked = [];
  const answered = new Map();
  const request = () => {
    const missing = places.filter((place) => answered.get(place) !== turn).slice(0, 64);
    if (!missing.length || isAsking) return;
    [isAsking, asked] = [true, missing];
    ask({ ask: "read", number: turn, from: span[0], to: span[1], most, signals: missing, over });
  };
  const lens = {
    first: 0, last: -1, length: 1, base: 0, size: 1, newest: -1,
    // The numbers of a signal, if they are there.
    of: ({ place }) => data.get(place) ?? null,
    // Looks at these steps with room for so many stretches.
    look(from, to, room, signals) {
      places = signals;
      if (!span || span[0] !== from || span[1] !== to || most !== room) {
        [span, most] = [[from, to], room];
        turn = (turn + 1) >>> 0;
        isAsking = false;
      }
      request();
    },
    // Asks again, as behind a broken connection or for what came since.
    again() {
      if (!span) return;
      turn = (turn + 1) >>> 0;
      isAsking = false;
      request();
    },
    // Takes an answer.
    take(buffer) {
      const words = new DataView(buffer);
      if (words.getUint32(4, true) !== turn) return;
      const [first, length, count, signals] = [0, 1, 2, 3].map((nth) => words.getFloat64(8 + 8 * nth, true));
      // Counted in stretches, as those of a session are.
      const base = Math.round(first / length);
      if (base !== lens.base || length !== lens.length || count !== lens.size) data = new Map();
      Object.assign(lens, { first: base, base, length, size: count, last: base + count - 1, newest: Math.min(first + length * count - 1, span[1]) });
      const per = length === 1 ? 1 : 2;
      const numbers = new Float64Array(buffer, 40);
      for (let nth = 0, at = 0; nth < signals; nth++, at += 1 + per * count) {
        const least = new Float64Array(count);
        const greatest = per === 1 ? least : new Float64Array(count);
        for (let i = 0; i < count; i++) {
          least[i] = numbers[at + 1 + per * i];
          if (per === 2) greatest[i] = numbers[at + 2 + 2 * i];
        }
        data.set(numbers[at], { least, greatest });
      }
      for (const place of asked) answered.set(place, turn);
      isAsking = false;
      request();
      changed();
    },
  };
  return lens;
};
