// What the theme leaves out for those who listen or have no mouse: names of both side bars, code that scrolls by keyboard.
document.addEventListener("DOMContentLoaded", () => {
  const named = { ".sidebar-drawer": "Pages", ".toc-drawer": "On this page" };
  for (const [selector, name] of Object.entries(named)) document.querySelectorAll(selector).forEach((each) => each.setAttribute("aria-label", name));
  document.querySelectorAll(".highlight pre").forEach((each) => each.setAttribute("tabindex", "0"));
  document.querySelectorAll("label.overlay").forEach((each) => each.setAttribute("aria-hidden", "true")); // closes a drawer that has a button, too
});
