/** Errors with the codes of the Python package (`dfcgs_codec.errors`), and two of the player's own. */
export type Code =
  | "not-a-dgs-file" | "unsupported" | "model-mismatch" | "truncated" | "corrupt" | "limit" | "resources" | "verification"
  | "network" | "browser";

export class PlayerError extends Error {
  /** `offset`: byte of the file, where one is known */
  constructor(readonly code: Code, message: string, readonly offset?: number) {
    super(offset === undefined ? message : `${message} (byte ${offset})`);
  }

  static of(error: unknown): PlayerError {
    if (error instanceof PlayerError) return error;
    return new PlayerError("browser", error instanceof Error ? error.message : String(error));
  }
}

/** Errors as they cross the border of a worker. */
export interface PlainError { code: Code; message: string }

export const plain = (error: unknown): PlainError => {
  const { code, message } = PlayerError.of(error);
  return { code, message };
};
export const raised = ({ code, message }: PlainError): PlayerError => new PlayerError(code, message);
