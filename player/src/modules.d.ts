declare module "worker:code" { const text: string; export default text; }
declare module "package:assets" { const assets: import("./assets").AssetsText; export default assets; }
