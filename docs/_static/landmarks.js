// What the theme leaves out for those who listen or have no mouse: names of both side bars, code that scrolls by keyboard.
document.addEventListener("DOMContentLoaded", () => {
  const named = { ".sidebar-drawer": "Pages", ".toc-drawer": "On this page" };
  for (const [selector, name] of Object.entries(named)) document.querySelectorAll(selector).forEach((each) => each.setAttribute("aria-label", name));
  document.querySelectorAll(".highlight pre").forEach((each) => each.setAttribute("tabindex", "0"));
  document.querySelectorAll(".content-icon-container").forEach((each) => {
    each.setAttribute("role", "navigation"); // the page's source, the scheme
    each.setAttribute("aria-label", "This page");
  });
  document.querySelectorAll(".table-wrapper").forEach((each) => {
    for (const [name, value] of Object.entries({ tabindex: "0", role: "group", "aria-label": "Table" })) each.setAttribute(name, value);
  });
  document.querySelectorAll("th").forEach((each) => {
    if (!each.textContent.trim()) each.replaceWith(document.createElement("td")); // a corner is no heading
  });
  document.querySelectorAll("label.overlay").forEach((each) => each.setAttribute("aria-hidden", "true")); // closes a drawer that has a button, too
});
