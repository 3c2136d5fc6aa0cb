// localStorage as browsers have it: everything becomes a string. The hook stores an absent user name and reads back
// "undefined", and a shim kinder than a browser would hide that.

class MemoryStorage {
  #items = new Map();

  getItem(key) {
    return this.#items.get(String(key)) ?? null;
  }

  setItem(key, value) {
    this.#items.set(String(key), String(value));
  }

  removeItem(key) {
    this.#items.delete(String(key));
  }
}

globalThis.localStorage = new MemoryStorage();
