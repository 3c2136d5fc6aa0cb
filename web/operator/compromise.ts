// The operator has a robot lie: the only thing that this page does to the gateway. Why not, in words, or undefined.

const ANSWER_WITHIN_MS = 4000;

export async function compromise(token: string, address: string, attack: string): Promise<string | undefined> {
  try {
    const answer = await fetch("/api/compromise", {
      method: "POST",
      headers: { Authorization: `Bearer ${token}`, "Content-Type": "application/json" },
      body: JSON.stringify({ address, attack }),
      cache: "no-store",
      credentials: "omit",
      redirect: "error",
      signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
    });
    if (answer.ok) return undefined;
    const words: unknown = await answer.json();
    const said = typeof words === "object" && words !== null && "error" in words ? words.error : undefined;
    return typeof said === "string" ? said : `The gateway answered ${answer.status}.`;
  } catch {
    return "The gateway does not answer.";
  }
}
