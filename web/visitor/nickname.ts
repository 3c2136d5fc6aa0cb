// A nickname to begin with: the one that was used last, else one that is easy to say and seldom taken.

const KEY = "phalanx.nickname";
const NAMES = [
  "Badger", "Beaver", "Falcon", "Ferret", "Gecko", "Heron", "Ibex", "Jackdaw", "Kestrel", "Lemur", "Lynx", "Magpie", "Marten",
  "Newt", "Ocelot", "Osprey", "Otter", "Pika", "Plover", "Puffin", "Quokka", "Raven", "Robin", "Seal", "Shrew", "Stoat",
  "Swift", "Tapir", "Vole", "Wombat", "Wren", "Yak",
];
/** The server cuts it there. */
export const NICKNAME_MAX = 32;

/** `chance` is in [0, 1). */
export function madeUp(chance: number): string {
  const number = Math.floor(chance * NAMES.length * 90);
  return `${NAMES[number % NAMES.length] ?? ""} ${10 + Math.floor(number / NAMES.length)}`;
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
