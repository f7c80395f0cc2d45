/** Light and dark, and the colours that canvases draw with. */

const KEY = "tempog-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

// Okabe and Ito's colours, as tempog.views.objects has them; on dark ground lighter ones of the same hues.
const OBJECT_COLOURS = {
  light: ["#0073b3", "#d65e00", "#009e73", "#cc78a6", "#66309a", "#8c574a"],
  dark: ["#56b4e9", "#f08a3c", "#2fc79b", "#e79ac3", "#b790e8", "#cfa08f"],
};
const SCHEMES = {
  light: {
    unexplored: "#bdbfc4",
    ink: "#17191f",
    halo: "#ffffff",
    lone: "#b97f00",
    appeared: "#00795a",
    vanished: "#c24e00",
    moved: "#005a8c",
    accent: "#0b5c8f",
    strip: "#5b6470",
    strip_pale: "#c9ced6",
    gap: "#9aa1ab",
    ground: "#ffffff",
    people: "#c2267e",
  },
  dark: {
    unexplored: "#3a3d42",
    ink: "#f2f3f5",
    halo: "#101217",
    lone: "#e69f00",
    appeared: "#2fc79b",
    vanished: "#ff9a52",
    moved: "#6cc1f2",
    accent: "#6cc1f2",
    strip: "#aab2bd",
    strip_pale: "#444b55",
    gap: "#6d747f",
    ground: "#171a1f",
    people: "#ff8cc6",
  },
};

/** @returns {"light" | "dark"} */
export function themeName() {
  const chosen = document.documentElement.dataset.theme;
  return chosen === "light" || chosen === "dark" ? chosen : dark.matches ? "dark" : "light";
}

/** Colours of the canvases. */
export function colours() {
  return SCHEMES[themeName()];
}

/** The colour of the k-th object. @param {number} k */
export function objectColour(k) {
  const all = OBJECT_COLOURS[themeName()];
  return all[k % all.length];
}

/** Exchange light and dark, and remember it if it is not what the system says. */
export function switchTheme() {
  const wanted = themeName() === "dark" ? "light" : "dark";
  const ofSystem = dark.matches ? "dark" : "light";
  if (wanted === ofSystem) localStorage.removeItem(KEY);
  else localStorage.setItem(KEY, wanted);
  applyTheme();
}

/** What was chosen before, or what the system says. */
export function applyTheme() {
  const chosen = localStorage.getItem(KEY);
  if (chosen) document.documentElement.dataset.theme = chosen;
  else delete document.documentElement.dataset.theme;
  dispatchEvent(new Event("themechange"));
}

dark.addEventListener("change", () => dispatchEvent(new Event("themechange")));
