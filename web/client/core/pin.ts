// The pin: the one secret that a QR code carries (Qrkey §III-D).

import { BadPin } from "./errors";

const DIGITS = /^[0-9]{4,64}$/;

/** Decimal digits as text: leading zeros count. Printing one, or putting it into JSON, gives `<Pin>`. */
export class Pin {
  readonly #digits: string;

  /** @throws BadPin */
  constructor(digits: unknown) {
    if (typeof digits !== "string" || !DIGITS.test(digits)) throw new BadPin();
    this.#digits = digits;
  }

  /** The secret itself. Call it only to derive, store or show the pin. */
  reveal(): string {
    return this.#digits;
  }

  equals(other: Pin): boolean {
    return this.#digits === other.#digits;
  }

  toString(): string {
    return "<Pin>";
  }

  toJSON(): string {
    return "<Pin>";
  }
}
