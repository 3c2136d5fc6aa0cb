// Which language a page speaks: what its address says, else the first that the browser prefers and we have.

const LANGUAGES = ["en", "de"] as const;
export type Language = (typeof LANGUAGES)[number];

/** `search` of an address: `?lang=de` forces a language. `preferred` as in `navigator.languages`. */
export function languageOf(search: string, preferred: readonly string[]): Language {
  const wanted = [new URLSearchParams(search).get("lang") ?? "", ...preferred];
  const known = wanted.map((tag) => LANGUAGES.find((each) => each === tag.toLowerCase().split("-")[0]));
  return known.find((each) => each !== undefined) ?? "en";
}

/** The path of another page, which speaks the language that this one's address forces, if it does. */
export function inSameLanguage(path: string, search: string): string {
  const forced = new URLSearchParams(search).get("lang");
  return forced === null ? path : path.replace("#", `?lang=${languageOf(search, [])}#`);
}

/** Load the page's language, and name the page in it. `german` loads its texts: only those who read them wait for them. */
export async function speak(german: () => Promise<void>, title: () => string): Promise<void> {
  let language = languageOf(window.location.search, navigator.languages);
  try {
    if (language === "de") await german();
  } catch {
    // They did not come over a bad network: a page in English is better than none.
    language = "en";
  }
  document.documentElement.lang = language;
  document.title = title();
}
