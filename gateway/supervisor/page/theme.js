// @ts-check
// Loaded before the page is drawn, so that the other colours do not flash first.
{
  let chosen = null;
  try {
    chosen = localStorage.getItem("pitch-gateway-colours");
  } catch {
    // Without storage: the system's colours.
  }
  if (chosen === "light" || chosen === "dark") {
    document.documentElement.dataset.theme = chosen;
  }
}
