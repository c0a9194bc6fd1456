/** Elements of the page, made by script: no markup is ever parsed from text. */

/**
 * Make an element.
 *
 * @param {string} tag
 * @param {Object} attributes attributes by name; a value that is null or false is left out
 * @param {...(Node|string)} children
 * @returns {HTMLElement}
 */
export function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children);
  return node;
}

/** Set the text of a node if it differs: equal text causes no layout. */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

let numIds = 0;

/** An id that no other element of the page has, for labels. */
export function uniqueId(prefix) {
  numIds += 1;
  return `${prefix}-${numIds}`;
}

/**
 * Watch whether a part of the page can be seen: on the screen, not in a closed group, not in a
 * hidden tab.
 *
 * @param {Element} node
 * @param {function(): void} onShown called when it becomes visible
 * @returns {{isShown: boolean}} the present state
 */
export function watchVisibility(node, onShown = () => {}) {
  let isIntersecting = false;
  const state = {
    get isShown() {
      return isIntersecting && !document.hidden;
    },
  };
  const observer = new IntersectionObserver((entries) => {
    const was = isIntersecting;
    isIntersecting = entries.at(-1).isIntersecting;
    if (isIntersecting && !was) onShown();
  });
  observer.observe(node);
  document.addEventListener("visibilitychange", () => {
    if (state.isShown) onShown();
  });
  return state;
}
