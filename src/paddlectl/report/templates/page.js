for (const episode of document.querySelectorAll(".episode")) {
  const [film] = episode.getAnimations();
  const hold = episode.querySelector(".hold input");
  const steps = episode.querySelector(".steps");
  const [back, forward] = steps.querySelectorAll("button");
  const place = steps.querySelector("input");
  const {delay, duration} = film.effect.getComputedTiming();
  const each = Number(episode.dataset.each);
  const last = Number(place.max);
  const now = () => Math.min(last, Math.floor((film.currentTime - delay) % duration / each));
  const tell = () => {
    place.value = now();
    place.setAttribute("aria-valuetext", `picture ${now() + 1} of ${last + 1}`);
  };
  const show = (picture) => {
    hold.checked = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    film.currentTime = delay + (Math.max(0, Math.min(last, picture)) + 0.5) * each;
    tell();
  };
  back.onclick = () => show(now() - 1);
  forward.onclick = () => show(now() + 1);
  place.oninput = () => show(Number(place.value));
  setInterval(tell, each);
  tell();
  steps.hidden = false;
}
