// All texts of the pages are in web/texts, one file for each language.

import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import ts from "typescript";
import { describe, expect, test } from "vitest";
import { inSameLanguage, languageOf } from "../texts";
import * as de from "../texts/de";
import * as en from "../texts/en";

const WEB = join(import.meta.dirname, "..");
const PAGES = ["map", "operator", "viewer", "visitor"];
const SHOWN = ["alt", "label", "placeholder", "sure", "text", "title"];
/** Names of keys, commands and addresses are the same in every language. */
const SAME = /^(Tab|W A S D|ms|phalanx link invite --role operator|http:\/\/127\.0\.0\.1|http:\/\/…#j=…|1234 5678)$/;

/** What people read or hear of a file that is written in it: between tags, in attributes that are shown, or two words. */
function textsIn(path: string, source: string): string[] {
  const found: string[] = [];
  const visit = (node: ts.Node): void => {
    const text = ts.isJsxText(node) || ts.isStringLiteralLike(node) || ts.isTemplateLiteralToken(node) ? node.text.trim() : "";
    if (/\p{L}{2}/u.test(text) && !SAME.test(text) && isShown(node, text)) found.push(`${path}: ${text}`);
    ts.forEachChild(node, visit);
  };
  visit(ts.createSourceFile(path, source, ts.ScriptTarget.Latest, true, ts.ScriptKind.TSX));
  return found;
}

function isShown(node: ts.Node, text: string): boolean {
  if (ts.isJsxText(node)) return true;
  const attribute = ts.findAncestor(node, ts.isJsxAttribute)?.name.getText();
  if (attribute !== undefined && !/^on[A-Z]/.test(attribute)) {
    const isNamed = ts.isStringLiteral(node) && ts.isBinaryExpression(node.parent);
    return !isNamed && (SHOWN.includes(attribute) || (attribute.startsWith("aria-") && !/labelledby|describedby|live|hidden/.test(attribute)));
  }
  if (ts.isJsxExpression(node.parent)) return true;
  if (ts.findAncestor(node, ts.isImportDeclaration) || ts.findAncestor(node, ts.isTypeNode)) return false;
  // Messages of errors that no page shows, lists of keywords, and what stylesheets call things.
  const called = ts.findAncestor(node, (each) => ts.isNewExpression(each) || ts.isCallExpression(each));
  if (called && /^(super|new \w*Error)\(|\.split\(/.test(called.getText())) return false;
  return /\p{L}{2}\S* \p{L}/u.test(text) && !/sans-serif|^\(prefers-/.test(text);
}

function files(): string[] {
  return PAGES.flatMap((folder) =>
    readdirSync(join(WEB, folder), { recursive: true, encoding: "utf8" })
      .filter((name) => /\.tsx?$/.test(name) && !/\.test\./.test(name))
      .map((name) => join(folder, name)),
  );
}

describe("texts", () => {
  test("no page has one of its own", () => {
    expect(files().length).toBeGreaterThan(60);
    expect(files().flatMap((path) => textsIn(path, readFileSync(join(WEB, path), "utf8")))).toEqual([]);
  });

  test.each([
    "<p>Join</p>",
    '<p>{isOpen ? "Shut the door" : ""}</p>',
    '<button aria-label="Zoom" />',
    "<img alt={`Robot ${name}`} />",
    'setTrouble("It does not answer.")',
  ])("the scan finds %s", (source) => expect(textsIn("x.tsx", `const x = ${source};`)).toHaveLength(1));

  test.each(["common", "visitor", "operator", "viewer"] as const)("in German all of %s differ, and have what is put into them", (part) => {
    const names = (texts: object, path = ""): [string, unknown][] =>
      Object.entries(texts).flatMap(([key, value]: [string, unknown]) =>
        typeof value === "object" && value !== null ? names(value, `${path}${key}.`) : [[`${path}${key}`, value]],
      );
    const german = new Map(names(de[part]));
    const marks = Array.from({ length: 6 }, (_, i) => `<${i}>`);
    const shown = (text: unknown) => (typeof text === "function" ? [(text as (...all: string[]) => unknown)(...marks)].flat().join("") : String(text));
    for (const [name, text] of names(en[part])) {
      if (/Error$|decimal|stoppedWithin|times/.test(name)) continue; // of numbers alone
      const other = shown(german.get(name));
      for (const mark of marks) if (shown(text).includes(mark)) expect(other, name).toContain(mark);
      if (shown(text).split(" ").length > 4) expect(other, name).not.toBe(shown(text));
    }
  });
});

test("the language is the address's, else the first of the browser's that we have, else English", () => {
  expect(languageOf("?lang=de", ["en-US"])).toBe("de");
  expect(languageOf("?lang=xx", ["fr", "de-AT", "en"])).toBe("de");
  expect(languageOf("", ["en-GB", "de"])).toBe("en");
  expect(languageOf("", ["fr"])).toBe("en");
  expect(inSameLanguage("/projector#token=1", "?lang=de")).toBe("/projector?lang=de#token=1");
  expect(inSameLanguage("/projector#token=1", "?lang=%22%3E")).toBe("/projector?lang=en#token=1");
  expect(inSameLanguage("/projector#token=1", "")).toBe("/projector#token=1");
});
