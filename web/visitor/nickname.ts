// The initial nickname: the last one used, or a random one that is easy to say.

import { visitor as texts } from "../texts";

const KEY = "phalanx.nickname";
/** The server truncates longer ones. */
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
    // Full or forbidden: the next visit gets a random name.
  }
}
