"use strict";
// A list of everything on a page, found by some letters of a name and carried out by Enter.

// How well the letters of a query stand in a text in their order: larger is better, `null` if they do not. Letters
// behind each other and at the beginning of a word count more, long texts less.
const fuzzy = (query, text) => {
  const letters = query.toLowerCase().replace(/\s+/g, "");
  const lower = text.toLowerCase();
  const isStart = (at) => at === 0 || /[^a-z0-9]/.test(lower[at - 1]);
  // The rest of the letters, from one on, behind a place.
  const canFollow = (nth, at) => {
    for (; nth < letters.length; nth++) {
      at = lower.indexOf(letters[nth], at + 1);
      if (at < 0) return false;
    }
    return true;
  };
  let score = 0;
  let at = -1;
  for (let nth = 0; nth < letters.length; nth++) {
    let next = lower.indexOf(letters[nth], at + 1);
    if (next < 0) return null;
    // The beginning of a word before any place within one, if the rest can follow it.
    for (let other = next; next !== at + 1 && other >= 0; other = lower.indexOf(letters[nth], other + 1)) {
      if (!isStart(other)) continue;
      if (canFollow(nth + 1, other)) next = other;
      break;
    }
    score += (next === at + 1 && at >= 0 ? 8 : 0) + (isStart(next) ? 6 : 0) + 1;
    at = next;
  }
  return score + (lower.includes(query.toLowerCase().trim()) ? 20 : 0) - lower.length / 50;
};

const MOST_FOUND = 60;
// Ranks of what is found: what has every word of the query first, in the order of these ranks, then what has its letters.
const RANK = { prepared: 0, signal: 1, plot: 2, mark: 3, other: 4, fault: 5 };
const rankOf = (entry) => RANK[entry.rank ?? entry.kind] ?? RANK.other;
const foundOf = (all, query) => {
  const words = query.toLowerCase().split(/\s+/).filter((word) => word);
  const scored = all.map((entry) => {
    const text = `${entry.name} ${entry.kind}`;
    const hasWords = words.every((word) => text.toLowerCase().includes(word));
    const rank = rankOf(entry);
    const isBetween = rank !== RANK.prepared && rank !== RANK.fault;
    return { entry, score: query ? fuzzy(query, text) ?? (hasWords ? 0 : null) : 0, tier: hasWords ? rank : 10 + (isBetween ? RANK.other : rank) };
  });
  return scored.filter((one) => one.score !== null).sort((a, b) => a.tier - b.tier || b.score - a.score).map((one) => one.entry);
};
// The palette of a page. `entries` gives what can be found: `kind`, `name`, `detail`, a `rank` that is not that of its
// kind, and what Enter does.
const paletteOf = (entries) => {
  const dialog = document.createElement("dialog");
  dialog.id = "palette";
  dialog.setAttribute("aria-label", "Find");
  const field = document.createElement("input");
  for (const [name, value] of Object.entries({ type: "text", role: "combobox", "aria-label": "Find a signal, plot, fault, value, mark or requirement", "aria-expanded": "true", "aria-controls": "found", "aria-autocomplete": "list", autocomplete: "off", spellcheck: "false", placeholder: "Signal, plot, fault, value, mark, requirement" })) field.setAttribute(name, value);
  const list = document.createElement("ul");
  list.id = "found";
  list.setAttribute("role", "listbox");
  list.setAttribute("aria-label", "Found");
  const none = document.createElement("p");
  none.className = "hint";
  none.textContent = "Nothing has these letters in this order.";
  dialog.append(field, list, none);
  document.body.append(dialog);
  let all = [];
  let matches = [];
  let chosen = 0;
  const choose = (place) => {
    chosen = Math.min(Math.max(place, 0), matches.length - 1);
    [...list.children].forEach((row, nth) => row.setAttribute("aria-selected", String(nth === chosen)));
    const row = list.children[chosen];
    field.setAttribute("aria-activedescendant", row?.id ?? "");
    row?.scrollIntoView({ block: "nearest" });
  };
  const find = () => {
    const query = field.value.trim();
    matches = foundOf(all, query).slice(0, MOST_FOUND);
    list.replaceChildren(...matches.map((entry, nth) => {
      const row = document.createElement("li");
      row.id = "found-" + nth;
      row.setAttribute("role", "option");
      for (const [name, text] of [["name", entry.name], ["detail", entry.detail ?? ""], ["kind", entry.kind]]) {
        const part = document.createElement("span");
        part.className = name;
        part.textContent = text;
        row.append(part);
      }
      row.addEventListener("click", () => carryOut(entry));
      return row;
    }));
    list.hidden = !matches.length;
    none.hidden = matches.length > 0;
    choose(0);
  };
  // A field that is no longer shown would still take the next key, until the page is drawn anew.
  const close = () => {
    dialog.close();
    if (dialog.contains(document.activeElement)) document.activeElement.blur();
  };
  const carryOut = (entry) => {
    close();
    entry.does();
  };
  field.addEventListener("input", find);
  dialog.addEventListener("keydown", (event) => {
    const keys = {
      ArrowDown: () => choose(chosen + 1), ArrowUp: () => choose(chosen - 1), PageDown: () => choose(chosen + 8), PageUp: () => choose(chosen - 8),
      Enter: () => matches[chosen] && carryOut(matches[chosen]), Escape: close,
    };
    // No key reaches the page behind: neither does Enter, with which an armed fault would be let go.
    event.stopPropagation();
    if (!keys[event.key] || event.isComposing) return;
    event.preventDefault();
    keys[event.key]();
  });
  // A click beside it closes it.
  dialog.addEventListener("click", (event) => event.target === dialog && close());
  const open = () => {
    if (dialog.open) return;
    all = entries();
    field.value = "";
    dialog.showModal();
    find();
    field.focus();
  };
  return { open, dialog };
};
