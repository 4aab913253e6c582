// New runs that repeat this one up to a step and are held there, and the command line of a checkpoint.

let branches = [];
// The step at cursor A or, without it, the next one of a held session and the last checkpoint of a recorded run.
const branchFrom = () => {
  const list = about.checkpoints ?? [];
  const cursor = cursors.steps[0];
  const step = cursor ?? (about.recorded ? list.at(-1)?.step : state?.step) ?? null;
  return { step, isChosen: cursor !== null, checkpoint: step === null ? undefined : list.findLast((one) => one.step <= step) };
};
const isHeld = () => state?.state === "paused";
const branchWords = ({ step, isChosen, checkpoint: one }) => {
  if (step === null) return "Cursor A chooses the step.";
  const at = `step ${step} (${seconds(step * period())} s)`;
  if (!one) return `No checkpoint lies before ${isChosen ? "cursor A" : at}: the run is repeated from its beginning.`;
  const gap = !isChosen ? "the last checkpoint; cursor A chooses another step" : step === one.step ? "exactly at cursor A" : `${seconds((step - one.step) * period())} s before cursor A`;
  return `From step ${one.step} (${seconds(one.time_s)} s): ${gap}.`;
};
const showBranch = () => {
  byId("branch-box").hidden = !(about.recorded || isHeld() || branches.length);
  const from = branchFrom();
  const { step, isChosen, checkpoint } = from;
  write(byId("branch-says"), branchWords(from));
  byId("branch-command").parentElement.hidden = byId("copy-branch").hidden = !checkpoint;
  const until = isChosen ? ` --pause-at ${step / about.rate_hz} --panel` : "";
  if (checkpoint) write(byId("branch-command"), `hil run --from ${quoted(checkpoint.folder)}${until}`);
  byId("branch").disabled = step === null || !(about.recorded || isHeld()) || branches.some((one) => one.state === "starting" || one.state === "held");
};
const armBranch = () => {
  const { step } = branchFrom();
  if (step === null || byId("branch").disabled) return;
  const title = `from step ${step} (${seconds(step * period())} s)`;
  arm({ title, words: ["Branch", "starts a new run that is held there", "no branch"], get disabled() { return byId("branch").disabled; }, click: () => ask({ ask: "branch", step }) });
};
byId("branch").addEventListener("click", armBranch);
byId("copy-branch").addEventListener("click", () => drawer.copy(byId("branch-command").textContent + "\n", "the command"));

const branchTones = { starting: "", held: "good", refused: "bad", ended: "" };
const listBranches = (told) => {
  const before = branches.at(-1)?.state;
  ({ branches } = told);
  const newest = branches.at(-1);
  byId("branches").replaceChildren(...branches.toReversed().map((one) => {
    const row = make("li");
    const label = make("span", "", { class: "badge" });
    badge(label, one.state, branchTones[one.state]);
    row.append(label, ` step ${one.step}: ${one.text}${one.session ? `, session ${one.session}` : ""}`);
    if (one.panel) row.append(" ", make("a", "Open its panel", { href: one.panel, target: "_blank", rel: "noopener" }));
    for (const text of [one.folder, one.command]) if (text) row.append(make("br"), make("code", text));
    return row;
  }));
  if (newest && newest.state !== before) write(byId("status"), `branch ${newest.state}: ${newest.text}`);
  root.dataset.branch = newest?.state ?? "";
  if (about) showBranch();
};
