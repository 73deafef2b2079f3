// Ties the timeline, the viewer, the pictures and the tables together. Texts go in as text only.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
let viewer = null, timeline = null, playing = null, chosen = -1;

function tell(frame) {
  byId("told").textContent = data.told[frame];
  document.querySelectorAll("tr.here").forEach((row) => row.classList.remove("here"));
  const row = document.querySelector(`tr[data-frame="${frame}"]`);
  if (row) row.classList.add("here");
}

// A frame of the report: the contact shown goes there, or the worst one that has the frame.
function goTo(frame) {
  tell(frame);
  if (!viewer) return;
  const has = (contact) => contact.view && contact.view.frames.includes(frame);
  let number = chosen >= 0 && has(data.contacts[chosen]) ? chosen : data.contacts.findIndex(has);
  if (number < 0) {
    const far = (contact) => contact.view ? Math.abs(contact.worst - frame) : Infinity;
    number = data.contacts.reduce((best, contact, k) =>
      far(contact) < far(data.contacts[best]) ? k : best, 0);
  }
  showContact(number, frame);
}

async function showContact(number, frame) {
  const contact = data.contacts[number];
  if (!contact || !contact.view || !viewer) return;
  const at = contact.view.frames.indexOf(frame);
  const place = at >= 0 ? at : contact.view.worst;
  if (number !== chosen) {
    chosen = number;
    byId("contact").value = String(number);
    document.querySelectorAll("figure").forEach((figure) =>
      figure.classList.toggle("here", figure.dataset.contact === String(number)));
    byId("slider").max = String(contact.view.frames.length - 1);
    await viewer.show(contact.view, place);
    if (timeline) timeline.mark(contact.first, contact.last);
  } else {
    viewer.set({ frame: place });
  }
}

function changed({ state, view, largest, poses: shown }) {
  const frame = view.frames[state.frame], two = shown.length > 1;
  byId("slider").value = String(state.frame);
  byId("at").textContent = data.labels[frame];
  byId("names").children[0].textContent = two && state.mode === "after" ? "" : view.names[0];
  byId("names").children[1].textContent = two && state.mode !== "before" ? view.names[1] : "";
  byId("line").hidden = !two || state.mode !== "wipe";
  byId("line").style.left = `${100 * state.wipe}%`;
  byId("wipe").disabled = !two || state.mode !== "wipe";
  document.querySelectorAll("[data-mode]").forEach((button) => {
    button.setAttribute("aria-pressed", String(two && button.dataset.mode === state.mode));
    button.disabled = !two;
  });
  byId("colour").disabled = !two;
  byId("legend").hidden = !two || state.colour !== "displacement";
  byId("most").textContent = `${(100 * largest * view.step / view.size).toPrecision(2)} % of the size`;
  byId("whole").textContent = view.whole ? "" : "Thinned out away from the contact.";
  tell(frame);
}

function play() {
  if (playing) { clearInterval(playing); playing = null; } else {
    playing = setInterval(() => {
      viewer.set({ frame: (viewer.state.frame + 1) % viewer.view.frames.length });
    }, 110);
  }
  byId("play").textContent = playing ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", String(Boolean(playing)));
}

function start() {
  timeline = drawTimeline(data, goTo);
  const shown = data.contacts.some((contact) => contact.view);
  if (shown && typeof THREE !== "undefined") {
    byId("viewer").classList.add("ready");
    try {
      viewer = new Viewer(byId("stage"), data.colours, changed);
    } catch (error) {
      byId("viewer").classList.remove("ready");
      byId("no-viewer").hidden = false;
    }
  }
  document.addEventListener("click", ({ target }) => {
    const frame = target.closest("[data-go]"), contact = target.closest("[data-contact]");
    if (frame) goTo(Number(frame.dataset.go));
    else if (contact) {
      const number = Number(contact.dataset.contact);
      tell(data.contacts[number].worst);
      showContact(number, data.contacts[number].worst);
    } else return;
    if (viewer) byId("viewer").scrollIntoView({ block: "nearest", behavior: "smooth" });
  });
  addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((part) => { part.open = true; });
  });
  if (!viewer) return;
  const on = (id, event, change) => byId(id).addEventListener(event, ({ target }) => change(target));
  on("contact", "change", ({ value }) => showContact(Number(value), -1));
  on("slider", "input", ({ value }) => viewer.set({ frame: Number(value) }));
  on("wipe", "input", ({ value }) => viewer.set({ wipe: Number(value) / 100 }));
  on("colour", "change", ({ value }) => viewer.set({ colour: value }));
  on("red", "change", ({ checked }) => viewer.set({ red: checked }));
  on("clear", "change", ({ checked }) => viewer.set({ clear: checked }));
  on("play", "click", play);
  on("next", "click", () => {
    const seen = data.contacts.filter((contact) => contact.view).length;
    showContact((chosen + 1) % seen, -1);
  });
  on("close", "click", () => viewer.look(true));
  on("far", "click", () => viewer.look(false));
  document.querySelectorAll("[data-mode]").forEach((button) =>
    button.addEventListener("click", () => viewer.set({ mode: button.dataset.mode })));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    viewer.dirty = true;
  });
  showContact(data.contacts.findIndex((contact) => contact.view), -1);
}

start();
