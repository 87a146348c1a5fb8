// Pointing at a setting, in a plot or in the table, picks it out everywhere.
const picks = [...document.querySelectorAll('[data-row]')];
const light = row => {
  for (const one of picks) one.classList.toggle('lit', one.dataset.row === row);
  for (const svg of document.querySelectorAll('svg')) svg.classList.toggle('dim', row !== null && svg.querySelector('g.pick') !== null);
};
for (const one of picks) {
  one.addEventListener('mouseenter', () => light(one.dataset.row));
  one.addEventListener('mouseleave', () => light(null));
}
