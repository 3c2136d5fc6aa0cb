// @vitest-environment jsdom
// The mission editor's address: it opens and closes the editor, and is no link that the page enters by.

import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { useFragment } from "./address";
import { useEntry } from "./entry";

let root: Root | undefined;

function Page() {
  const [isOpen, open] = useFragment("#mission");
  const [entry] = useEntry();
  return (
    <button onClick={() => open(!isOpen)}>
      {String(isOpen)} {JSON.stringify(entry)}
    </button>
  );
}

beforeEach(async () => {
  vi.stubGlobal("IS_REACT_ACT_ENVIRONMENT", true);
  window.history.replaceState(null, "", "/#mission");
  root = createRoot(document.body.appendChild(document.createElement("div")));
  await act(async () => root?.render(<Page />));
});

afterEach(() => {
  act(() => root?.unmount());
  document.body.replaceChildren();
  vi.unstubAllGlobals();
});

async function changed(work: () => void): Promise<string> {
  await act(async () => {
    const done = new Promise((resolve) => window.addEventListener("hashchange", resolve, { once: true }));
    work();
    await done;
  });
  return document.body.textContent ?? "";
}

it("opens by its address and by a button, and the back button closes it", async () => {
  const none = '{"kind":"none","refused":false}';
  expect(document.body.textContent).toBe(`true ${none}`);
  const press = () => document.querySelector("button")?.click();
  expect(await changed(press)).toBe(`false ${none}`);
  expect(await changed(press)).toBe(`true ${none}`);
  expect(window.location.hash).toBe("#mission");
  expect(await changed(() => window.history.back())).toBe(`false ${none}`);
});

it("enters by a link that is pasted, and does not show it", async () => {
  expect(await changed(() => (window.location.hash = "#j=broken"))).toContain('"refused":true');
  expect(window.location.hash).toBe("");
});
