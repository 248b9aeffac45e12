// SPDX-License-Identifier: Apache-2.0
// Numbers formatted for people.

export const isNumber = value => typeof value === 'number' && Number.isFinite(value);

export function fixed(value, digits) {
  return isNumber(value)
    ? value.toLocaleString('en-US', {minimumFractionDigits: digits, maximumFractionDigits: digits})
    : '–';
}

export const whole = value => fixed(value, 0);

// 12,345,678 as "12.3M": for axes and tiles.
export function short(value) {
  if (!isNumber(value)) return '–';
  for (const [unit, letter] of [
    [1e9, 'G'],
    [1e6, 'M'],
    [1e3, 'k'],
  ])
    if (Math.abs(value) >= unit) return String(Number((value / unit).toPrecision(3))) + letter;
  return String(Number(value.toPrecision(3)));
}

export function significant(value, digits = 3) {
  if (!isNumber(value)) return '–';
  if (value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e6))
    return value.toExponential(digits - 1);
  return String(Number(value.toPrecision(digits)));
}

export function bytes(value) {
  if (!isNumber(value)) return '–';
  for (const [unit, name] of [
    [2 ** 30, 'GiB'],
    [2 ** 20, 'MiB'],
    [2 ** 10, 'KiB'],
  ])
    if (value >= unit) return `${Number((value / unit).toPrecision(3))} ${name}`;
  return `${value} B`;
}

export function duration(seconds) {
  if (!isNumber(seconds)) return '–';
  if (seconds < 10) return `${fixed(seconds, 1)} s`;
  const total = Math.round(seconds),
    h = Math.floor(total / 3600),
    m = Math.floor(total / 60) % 60,
    s = total % 60;
  if (h) return `${h} h ${m} min`;
  return m ? `${m} min ${s} s` : `${s} s`;
}

export function spread(mean, deviation, digits) {
  return isNumber(deviation)
    ? `${fixed(mean, digits)} ± ${fixed(deviation, digits)}`
    : fixed(mean, digits);
}
