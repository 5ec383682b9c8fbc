// Elements of the document.

export function element<K extends keyof HTMLElementTagNameMap>(
  name: K, content: string | readonly (Node | string)[] = [],
): HTMLElementTagNameMap[K] {
  const made = document.createElement(name);
  made.append(...(typeof content === "string" ? [content] : content));
  return made;
}

export function byId<T extends HTMLElement = HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

/** Sets a text only where it differs, so that readers aloud hear a change once. */
export function say(target: HTMLElement, text: string): void {
  if (target.textContent !== text) target.textContent = text;
}
