// @ts-check
// Loaded before the page is drawn, so that nobody is dazzled by the other colours first.
{
  let chosen = null;
  try {
    chosen = localStorage.getItem("pitch-gateway-colours");
  } catch {
    // A browser that keeps nothing: the system's colours.
  }
  if (chosen === "light" || chosen === "dark") {
    document.documentElement.dataset.theme = chosen;
  }
}
