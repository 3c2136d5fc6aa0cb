// A nickname to begin with: the one that was used last, else one that is easy to say and seldom taken.

import { visitor as texts } from "../texts";

const KEY = "phalanx.nickname";
/** The server cuts it there. */
export const NICKNAME_MAX = 32;

/** `chance` is in [0, 1). */
export function madeUp(chance: number): string {
  const names = texts.nicknames;
  const number = Math.floor(chance * names.length * 90);
  return `${names[number % names.length] ?? ""} ${10 + Math.floor(number / names.length)}`;
}

export function lastNickname(storage: Pick<Storage, "getItem"> | undefined): string {
  try {
    return storage?.getItem(KEY) ?? "";
  } catch {
    return "";
  }
}

export function keepNickname(storage: Pick<Storage, "setItem"> | undefined, name: string): void {
  try {
    storage?.setItem(KEY, name);
  } catch {
    // Full or forbidden: the next one is made up.
  }
}
