// The search in place of that of mkdocs: a page that is a file may start no worker and fetch nothing, but load scripts.
document.addEventListener("DOMContentLoaded", () => {
  "use strict";
  const query = document.getElementById("mkdocs-search-query");
  const results = document.getElementById("mkdocs-search-results");
  const at = (path) => base_url.replace(/\/?$/, "/") + path;
  let found; // a promise of what finds documents

  const load = (path) => new Promise((resolve, reject) => {
    const script = document.createElement("script");
    Object.assign(script, { src: at(path), onload: resolve, onerror: reject });
    document.head.append(script);
  });

  const prepare = async () => {
    await Promise.all([load("search/lunr.js"), load("search/search_index.js")]);
    const documents = new Map(window.search_index.docs.map((one) => [one.location, one]));
    const index = lunr(function () {
      this.ref("location");
      this.field("title", { boost: 10 });
      this.field("text");
      documents.forEach((one) => this.add(one));
    });
    return (words) => {
      const beginnings = words.toLowerCase().split(/[^\p{L}\p{N}_]+/u).filter(Boolean);
      const hits = index.query((of) => {
        for (const word of beginnings) {
          of.term(lunr.stemmer(new lunr.Token(word, {})).toString(), { boost: 5 });
          of.term(word, { wildcard: lunr.Query.wildcard.TRAILING });
        }
      });
      return hits.slice(0, 50).map((hit) => documents.get(hit.ref));
    };
  };

  const show = async () => {
    const words = query.value.trim();
    if (words.length < 2) {
      results.replaceChildren();
      return;
    }
    const documents = (await (found ??= prepare()))(words);
    if (words !== query.value.trim()) return; // typed on meanwhile
    results.replaceChildren(...documents.map((one) => {
      const article = document.createElement("article");
      const link = Object.assign(document.createElement("a"), { href: at(one.location), textContent: one.title });
      const heading = document.createElement("h3");
      heading.append(link);
      article.append(heading, Object.assign(document.createElement("p"), { textContent: one.text.slice(0, 200) }));
      return article;
    }));
    if (!documents.length) results.textContent = results.dataset.noResultsText;
  };

  query.addEventListener("focus", () => (found ??= prepare()));
  query.addEventListener("input", show);
  query.form.addEventListener("submit", (event) => event.preventDefault());
  const asked = new URLSearchParams(location.search).get("q");
  if (asked) {
    query.value = asked;
    show();
  }
});
