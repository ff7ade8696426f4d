// Browsers start no worker for a page that is opened from a file; the search of the site is one. A hidden frame does its
// work instead. The theme would fetch such a script from the network.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.scope = frame.contentWindow;
      const own = this.scope.document;
      own.open();
      own.write("<!DOCTYPE html><html><body></body></html>");
      own.close();
      const place = new URL(url, document.baseURI);
      const load = (address) => new Promise((done, failed) => {
        const script = own.createElement("script");
        script.src = new URL(address, place);
        script.onload = done;
        script.onerror = failed;
        own.body.append(script);
      });
      this.scope.postMessage = (data) => this.tell(data);
      this.scope.importScripts = async (...addresses) => {
        for (const address of addresses) await load(address);
      };
      this.ready = load(place);
    }
    tell(data) {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      if (this.onmessage) this.onmessage(event);
    }
    postMessage(data) {
      const Message = this.scope.MessageEvent;
      this.ready.then(() => this.scope.dispatchEvent(new Message("message", { data })));
    }
    terminate() {
      this.scope.frameElement.remove();
    }
  };
}
