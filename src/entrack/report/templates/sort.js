// A click on a heading sorts its table; another click turns the order round.
for (const table of document.querySelectorAll("table")) {
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => heading.addEventListener("click", () => {
    const numeric = heading.classList.contains("number");
    const ascending = heading.ariaSort ? heading.ariaSort === "descending" : !numeric;
    headings.forEach((other) => other.removeAttribute("aria-sort"));
    heading.ariaSort = ascending ? "ascending" : "descending";
    const value = (row) => row.cells[column].dataset.value;
    const compare = (a, b) => {
      if (value(a) === "" || value(b) === "") return (value(a) === "") - (value(b) === "");
      const order = numeric ? value(a) - value(b) : value(a).localeCompare(value(b), undefined, {numeric: true});
      return ascending ? order : -order;
    };
    const body = table.tBodies[0];
    body.append(...[...body.rows].sort(compare));
  }));
}
