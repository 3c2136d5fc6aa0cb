// Address of the websocket of this page's swarm.

/** The websocket beside this page, also below a path of a reverse proxy. */
export function linkUrl(href: string, path = "link"): string {
  const url = new URL(path, href);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  url.hash = "";
  url.search = "";
  return url.href;
}
