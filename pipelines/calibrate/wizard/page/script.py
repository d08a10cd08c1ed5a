"""What runs in the browser: it lets no click be lost while a step is drawn anew."""

__all__ = ["HOLD", "LEAVING_PATH", "RELEASE", "SCRIPT"]

LEAVING_PATH = "/leaving"
"""Where a window tells that it is being closed or reloaded."""

SCRIPT = (
    """<script>(() => {
const page = window.wizard = {focus: null, pressed: false, held: null};
const named = at => at && at.closest ? at.closest("[data-test]") : null;
const on = (name, act) => document.addEventListener(name, act, true);
on("focusin", event => {
  const at = named(event.target);
  page.focus = at ? at.dataset.test : null;
});
for (const name of ["pointerdown", "keydown"]) on(name, () => { page.pressed = true; });
// not before the click that this makes has been told
for (const name of ["pointerup", "pointercancel", "keyup"])
  on(name, () => setTimeout(() => { page.pressed = false; }, 0));
window.addEventListener("blur", () => { page.pressed = false; });
on("click", event => {
  if (page.held === null || !named(event.target)) return;
  page.held.push(event.target);
  event.stopImmediatePropagation();
  event.preventDefault();
});
// what is where the other was: the same kind of element with the same text
const successor = old => {
  if (document.contains(old)) return old;
  const root = document.querySelector(`[data-test="${named(old).dataset.test}"]`);
  const like = at => at.tagName === old.tagName && at.textContent === old.textContent;
  return root === null || like(root) ? root : [...root.querySelectorAll(old.tagName)].find(like);
};
page.hold = () => {
  const at = document.activeElement;
  if (page.pressed || document.querySelector(".q-menu")) return false;
  if (at.dataset.told !== undefined && at.value !== at.dataset.told) return false;
  page.held = [];
  clearTimeout(page.watchdog);
  page.watchdog = setTimeout(page.release, 5000);
  return true;
};
page.release = () => {
  clearTimeout(page.watchdog);
  const held = page.held || [];
  page.held = null;
  if (document.activeElement === document.body && page.focus) {
    const at = document.querySelector(`[data-test="${page.focus}"]`);
    if (at) at.focus();
  }
  for (const old of held) { const at = successor(old); if (at) at.click(); }
};
window.addEventListener("beforeunload", () => navigator.sendBeacon("LEAVING"));
})()</script>"""
).replace("LEAVING", LEAVING_PATH)
"""Clicks that fall into a redrawing are held back and made again on what is drawn then."""
HOLD = "window.wizard.hold()"
"""Hold clicks back; false, and nothing held, while something is pressed, open or being typed."""
RELEASE = "setTimeout(window.wizard.release, 30)"
"""Once the step is drawn anew: give the focus back and make the clicks that were held back."""
