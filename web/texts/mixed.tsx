// A text with elements in it, such as a name in bold.

import { createElement, Fragment, type ReactNode } from "react";

export function Mixed({ parts }: { readonly parts: readonly ReactNode[] }) {
  return createElement(Fragment, null, ...parts);
}
