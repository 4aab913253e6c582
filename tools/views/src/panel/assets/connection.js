// The connection of a page to its server, and its beginning.
// ---- The connection ----

let socket = null;
let heardAt = 0;
let attempt = 0;
let retry = 0;
let isOver = false;
// What a session that ended has said stays; a recorded run is asked again and again.
const isFinal = () => isOver || (state?.ending?.verdict && !about?.recorded);
const isOpen = () => socket?.readyState === WebSocket.OPEN;
const ask = (message) => {
  if (isOpen()) socket.send(JSON.stringify(message));
};
const trouble = (text, mayRetry) => {
  const box = byId("trouble");
  box.hidden = !text;
  if (box.firstChild?.textContent === text) return;
  box.replaceChildren(make("span", text + " "));
  if (!mayRetry) return;
  const again = make("button", "Connect again", { type: "button" });
  again.addEventListener("click", () => {
    isOver = false;
    connect();
  });
  box.append(again);
};
let focusedBefore = null;
// What the controls were told last; `null` once there may be new ones.
let wasUsable = null;
const enable = () => {
  const isUsable = Boolean(isOpen() && state && !state.ending && state.state !== "starting" && !about?.recorded);
  if (isUsable === wasUsable) return;
  wasUsable = isUsable;
  for (const button of document.querySelectorAll("#pause, #step, #steps, #mark-form button, #inject button, #buttons button, #faults button, #clear-all, #tune-box button, #tune-box input")) button.disabled = !isUsable;
  // A control that was disabled for a while gets the focus back, unless it is elsewhere by now.
  const { activeElement } = document;
  if (!isUsable && activeElement?.disabled) focusedBefore = activeElement;
  if (!isUsable || !focusedBefore) return;
  if (activeElement === document.body || activeElement === focusedBefore) focusedBefore.focus();
  focusedBefore = null;
};
const lost = () => {
  socket = null;
  enable();
  root.dataset.connection = "lost";
  if (isFinal()) return;
  badge(byId("state"), "disconnected", "bad");
  trouble("The connection to the panel is lost; trying again.", true);
  clearTimeout(retry);
  retry = setTimeout(connect, Math.min(5000, 250 * 2 ** attempt++));
};
const heard = (data) => {
  heardAt = Date.now();
  if (typeof data !== "string") return take(data);
  const told = JSON.parse(data);
  if (root.dataset.connection !== "open" && told.tell !== "over") {
    root.dataset.connection = "open";
    attempt = 0;
    trouble("", false);
  }
  if (told.tell === "about") describe(told);
  else if (told.tell === "faults") listFaults(told);
  else if (told.tell === "tunable") listTunable(told);
  else if (told.tell === "state") show(told);
  else if (told.tell === "log") hear(told);
  else if (told.tell === "answer") answered(told);
  else if (told.tell === "measured") takeFigures(told);
  else if (told.tell === "where") listOccurrences(told);
  else if (told.tell === "branches") listBranches(told);
  else if (told.tell === "kept") listKept(told);
  else if (told.tell === "unreadable") trouble(told.text, false);
  else if (told.tell === "over") {
    isOver = true;
    root.dataset.over = told.text;
    if (!state?.ending || about?.recorded) {
      badge(byId("state"), "closed", "bad");
      trouble(`${told.text}.`, true);
    }
  }
  enable();
};
const connect = () => {
  clearTimeout(retry);
  // What was asked over the connection before is answered by nobody.
  for (const knob of asked.values()) knob.isAsking = false;
  asked.clear();
  if (!/^[0-9a-f]{32}$/.test(secret)) {
    badge(byId("state"), "no secret", "bad");
    return trouble("This address has no secret: open the whole address that hil panel printed.", false);
  }
  if (socket) {
    socket.onclose = socket.onmessage = socket.onopen = null;
    socket.close();
  }
  const mine = new WebSocket(`ws://${location.host}/live`);
  socket = mine;
  heardAt = Date.now();
  mine.binaryType = "arraybuffer";
  mine.onopen = () => {
    mine.send(JSON.stringify({ secret }));
    if (about) look();
  };
  mine.onmessage = ({ data }) => timed(() => heard(data));
  mine.onclose = lost;
};
// A lid that was closed, or a network that went: the old connection may never say so.
const check = () => {
  if (isFinal()) return;
  if (!socket || Date.now() - heardAt > 12000) connect();
};
setInterval(check, 2000);
addEventListener("online", check);
document.addEventListener("visibilitychange", () => {
  if (document.visibilityState === "visible") {
    check();
    drawSoon();
  }
});

watchStatus();
watchScroll();
const chosenTheme = () => ["dark", "light"].find((one) => one === recall("theme"));
const followTheme = () => setTheme(chosenTheme() ? chosenTheme() === "dark" : wantsDark.matches);
followTheme();
wantsDark.addEventListener("change", followTheme);
connect();
