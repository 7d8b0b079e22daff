// What a page remembers: through a reload, or for good.

const place = (isForGood) => (isForGood ? localStorage : sessionStorage);

export function recall(name, fallback, isForGood = false) {
  try {
    return JSON.parse(place(isForGood).getItem(`rrins-${name}`)) ?? fallback;
  } catch {
    return fallback; // a browser that keeps nothing
  }
}

export function keep(name, value, isForGood = false) {
  try {
    place(isForGood).setItem(`rrins-${name}`, JSON.stringify(value));
  } catch { /* a browser that keeps nothing */ }
}
