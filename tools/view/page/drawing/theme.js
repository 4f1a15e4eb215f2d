// Light or dark: what the system prefers, until the user chooses. Canvases read the colours here.

const listeners = [];
const colours = new Map();

export function colour(name) {
  let value = colours.get(name);
  if (value === undefined) {
    value = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    colours.set(name, value);
  }
  return value;
}

function apply(theme) {
  document.documentElement.dataset.theme = theme;
  colours.clear();
  for (const listener of listeners) listener();
}

export function onTheme(listener) {
  listeners.push(listener);
}

export function startTheme(button, asked) {
  const system = matchMedia("(prefers-color-scheme: dark)");
  let chosen = asked;
  const current = () => chosen ?? (system.matches ? "dark" : "light");
  system.addEventListener("change", () => apply(current()));
  button.addEventListener("click", () => {
    chosen = current() === "dark" ? "light" : "dark";
    apply(chosen);
  });
  apply(current());
}
