addEventListener("load", () => {
  // Tables that are wider than the page scroll by the keyboard, too.
  for (const table of document.querySelectorAll(".md-typeset__scrollwrap")) {
    if (table.scrollWidth > table.clientWidth) table.tabIndex = 0;
  }
  // Of a terminal's text only the commands are copied: no prompts, no remarks, nothing printed.
  for (const code of document.querySelectorAll("pre > code:has(.gp)")) {
    const commands = code.textContent.split("\n").filter((line) => line.startsWith("$ "));
    code.dataset.copy = commands.map((line) => line.slice(2).replace(/\s+# .*$/, "")).join("\n");
  }
});
