// A few words beside the pointer.

import { element } from "./element.js";

const box = element("div", { class: "tooltip", role: "tooltip", hidden: true });

export function showTooltip(sentence, { clientX, clientY }) {
  if (!box.isConnected) document.body.append(box);
  box.hidden = !sentence;
  if (!sentence) return;
  box.textContent = sentence;
  const left = Math.min(clientX + 14, innerWidth - box.offsetWidth - 6);
  const top = clientY + 18 + box.offsetHeight > innerHeight ? clientY - box.offsetHeight - 10 : clientY + 18;
  box.style.transform = `translate(${Math.max(left, 6)}px, ${top}px)`;
}

export const STEP_WORDS = {
  jump: "jump: a step longer than 5 mm, or than two samples draw; it can be felt and heard",
  hop: "hop: a step over twice the ordinary one, but no jump",
};

export const counted = (count, name) => (count ? `${count.toLocaleString("en")} ${name}${count > 1 ? "s" : ""}` : "");
