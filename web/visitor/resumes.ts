import { browserStores, ResumeStore } from "../client";

/** Resume secrets of this origin. */
export const resumeStore = new ResumeStore(browserStores());
