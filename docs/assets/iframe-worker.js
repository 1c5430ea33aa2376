// Makes the search work on pages that are opened from the disk. Browsers allow no Worker there, so its script runs in a
// hidden frame of the page instead. The name of this file keeps mkdocs-material from loading one from the network.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.srcdoc = "<!doctype html><title>Search</title>";
      this.inside = new Promise((resolve) => {
        frame.onload = () => {
          const inside = frame.contentWindow;
          inside.postMessage = (data) => {
            this.dispatchEvent(new MessageEvent("message", { data: structuredClone(data) }));
          };
          const script = inside.document.createElement("script");
          script.onload = () => resolve(inside);
          script.onerror = () => this.dispatchEvent(new ErrorEvent("error", { message: `cannot load ${url}` }));
          script.src = new URL(url, location.href);
          inside.document.head.append(script);
        };
      });
      this.frame = frame;
      document.body.append(frame);
    }

    async postMessage(data) {
      const inside = await this.inside;
      inside.dispatchEvent(new inside.MessageEvent("message", { data: inside.structuredClone(data) }));
    }

    terminate() {
      this.frame.remove();
    }
  };
}
