// The LED's colour: a palette, or any colour.

import { useEffect, useRef } from "react";
import { type Rgb, type SwarmLink, useSwarm } from "../client";
import { visitor as texts } from "../texts";

interface Props {
  readonly link: SwarmLink | undefined;
  readonly selected: string | undefined;
  readonly command: (name: string, payload: unknown) => boolean;
}

const PALETTE: readonly (readonly [keyof typeof texts.colours, string])[] = [
  ["red", "#ff2d2d"],
  ["orange", "#ff8a00"],
  ["yellow", "#ffe100"],
  ["green", "#18d860"],
  ["cyan", "#14d2e6"],
  ["blue", "#2f6bff"],
  ["purple", "#b04bff"],
  ["white", "#ffffff"],
];

/** A colour picker makes a hundred changes a second; ten are sent. */
const SEND_EVERY_MS = 100;

/** Use the robot's address as key: another robot must not receive a colour that waits for this one. */
export function Led({ link, selected, command }: Props) {
  const led = useSwarm(link, ({ swarm }) => (selected === undefined ? undefined : swarm.robots.get(selected)?.led));
  const waiting = useRef<{ colour: string; timer: ReturnType<typeof setTimeout> | undefined }>(undefined);

  useEffect(() => () => clearTimeout(waiting.current?.timer), []);

  function send(colour: string) {
    if (waiting.current) {
      waiting.current.colour = colour;
      return;
    }
    command("rgb_led", rgbOf(colour));
    const timer = setTimeout(() => {
      const last = waiting.current?.colour;
      waiting.current = undefined;
      if (last !== undefined && last !== colour) send(last);
    }, SEND_EVERY_MS);
    waiting.current = { colour, timer };
  }

  const disabled = selected === undefined;
  return (
    <fieldset className="panel led" disabled={disabled}>
      <legend>{texts.light}</legend>
      <div className="palette">
        {PALETTE.map(([name, colour]) => (
          <button
            key={name}
            type="button"
            className="swatch"
            aria-label={texts.lightOf(texts.colours[name])}
            style={{ backgroundColor: colour }}
            onClick={() => send(colour)}
          />
        ))}
        <input
          type="color"
          className="any-colour"
          data-testid="led-colour"
          aria-label={texts.lightOfAnyColour}
          value={hexOf(led)}
          onChange={(event) => send(event.target.value)}
        />
      </div>
    </fieldset>
  );
}

/** `#rrggbb` as the vocabulary's payload. */
export function rgbOf(colour: string): Rgb {
  const value = Number.parseInt(colour.slice(1), 16);
  return { red: value >> 16, green: (value >> 8) & 255, blue: value & 255 };
}

export function hexOf(led: Rgb | undefined): string {
  if (!led) return "#000000";
  return `#${[led.red, led.green, led.blue].map((value) => value.toString(16).padStart(2, "0")).join("")}`;
}
