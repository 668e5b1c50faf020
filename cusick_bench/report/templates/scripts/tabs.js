"use strict";
/* Links to sections become tabs (WAI-ARIA: arrows, Home and End move). Without scripts, and on paper, all sections show. */

function makeTabs(list) {
  const tabs = [...list.querySelectorAll("a")];
  const panels = tabs.map((tab) => document.getElementById(decodeURIComponent(tab.hash.slice(1))));
  if (tabs.length < 2) return;

  function show(chosen) {
    tabs.forEach((tab, place) => {
      tab.setAttribute("aria-selected", String(place === chosen));
      tab.tabIndex = place === chosen ? 0 : -1;
      panels[place].hidden = place !== chosen;
    });
  }

  /* A link to something inside a hidden panel shows that panel first. */
  function follow(hash) {
    const target = document.getElementById(decodeURIComponent(hash.slice(1)));
    const place = target ? panels.findIndex((panel) => panel.contains(target)) : -1;
    if (place < 0) return;
    show(place);
    target.scrollIntoView();
  }

  list.setAttribute("role", "tablist");
  tabs.forEach((tab, place) => {
    tab.setAttribute("role", "tab");
    tab.id = `tab-${place}`;
    tab.setAttribute("aria-controls", panels[place].id);
    panels[place].setAttribute("role", "tabpanel");
    panels[place].setAttribute("aria-labelledby", tab.id);
    tab.addEventListener("click", (event) => { event.preventDefault(); show(place); });
    tab.addEventListener("keydown", (event) => {
      const last = tabs.length - 1;
      const to = { ArrowRight: place === last ? 0 : place + 1, ArrowLeft: place ? place - 1 : last, Home: 0, End: last }[event.key];
      if (event.key === " ") tab.click();
      else if (to !== undefined) { show(to); tabs[to].focus(); }
      else return;
      event.preventDefault();
    });
  });
  show(0);
  addEventListener("hashchange", () => follow(location.hash));
  document.addEventListener("click", (event) => {  // the address stays as it is where a link is followed again
    const link = event.target.closest("a[href^='#']");
    if (link && !event.defaultPrevented) follow(link.hash);
  });
  follow(location.hash);
}

document.querySelectorAll("[data-tabs]").forEach(makeTabs);
