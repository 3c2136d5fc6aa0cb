// The texts of the language that the page speaks: English until another one is put in its place, before anything is shown.

import * as en from "./en";

export { inSameLanguage, languageOf, speak } from "./language";
export { Mixed } from "./mixed";

/** A copy that another language is written over. Marked as pure below: a page that uses none of a part loads none of it. */
const replaceable = <T extends object>(texts: T): T => ({ ...texts });

export const common = /* @__PURE__ */ replaceable(en.common);
export const visitor = /* @__PURE__ */ replaceable(en.visitor);
export const operator = /* @__PURE__ */ replaceable(en.operator);
export const viewer = /* @__PURE__ */ replaceable(en.viewer);
