// What the operator has the gateway do from this page. Why it did not, in words, or undefined.

const ANSWER_WITHIN_MS = 4000;

/** `stop` and `go` are answered by the gateway however busy it is. */
export type Order = "compromise" | "rotate" | "stop" | "go" | `link/${string}`;

export async function order(token: string, what: Order, words: object = {}): Promise<string | undefined> {
  try {
    const answer = await fetch(`/api/${what}`, {
      method: "POST",
      headers: { Authorization: `Bearer ${token}`, "Content-Type": "application/json" },
      body: JSON.stringify(words),
      cache: "no-store",
      credentials: "omit",
      redirect: "error",
      signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
    });
    if (answer.ok) return undefined;
    const said: unknown = await answer.json();
    const error = typeof said === "object" && said !== null && "error" in said ? said.error : undefined;
    return typeof error === "string" ? error : `The gateway answered ${answer.status}.`;
  } catch {
    return "The gateway does not answer.";
  }
}
