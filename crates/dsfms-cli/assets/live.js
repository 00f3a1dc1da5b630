// Added by `dsfms view` alone: what changes in the files comes into the open page, in place where that can
// be done, and frames of long clips come when they are asked for. A report itself may not connect to
// anything; here it may ask this server.
window.dsfmsLive = (() => {
  let shown = "{{version}}", busy = false;
  const ask = async (path) => {
    const answer = await fetch(path);
    if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
    return answer.text();
  };
  const look = async () => {
    const now = await ask("version");
    if (now === shown) return;
    const page = new DOMParser().parseFromString(await ask(""), "text/html");
    if (window.dsfms && dsfms.update(page)) shown = now; else location.reload();
  };
  setInterval(() => {
    if (busy) return;
    busy = true;
    look().catch(() => {}).finally(() => { busy = false; });
  }, 1000);
  // A template that keeps by what its organ was told has a page to draw on.
  if ("{{organ}}" === "true") addEventListener("DOMContentLoaded", () => {
    const link = Object.assign(document.createElement("a"), { href: "organ", id: "organ", className: "button", textContent: "Organ", title: "Draw what is organ and what is not" });
    const place = document.getElementById("page-buttons") || document.body;
    place.prepend(link);
  });
  return { frame: async (name) => JSON.parse(await ask(`frame/${name}`)) };
})();
