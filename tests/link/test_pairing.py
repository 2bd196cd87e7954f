"""The two sides of a pairing as pure machines: no socket, no clock, and everything an attacker can try."""

import random
import tracemalloc
from collections.abc import Callable

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import pairing
from common.errors import LinkError, WayfixError
from common.keys import CROCKFORD
from common.pairing import Board, Station, code_of, framed, length_of, plain_code, stretch
from common.units import NS_PER_S

CODE, OTHER_CODE = "7Q2M0XKD93ZT", "7Q2M0XKD93ZV"
BOARD_KEY, STATION_KEY, THIEF_KEY = b"b" * 32, b"s" * 32, b"t" * 32


def quick(code: str, salt: bytes) -> bytes:
    """In place of scrypt where thousands of exchanges are tried."""
    return (code.encode() + salt).ljust(32, b"\0")


def board(code: str = CODE, nonce: bytes = b"N" * 32, made: Callable[[str, bytes], bytes] = quick) -> Board:
    return Board(code, BOARD_KEY, "springer", nonce=nonce, opened_ns=0, stretch=made)


def station(code: str = CODE, key: bytes = STATION_KEY, nonce: bytes = b"n" * 32) -> Station:
    return Station(code, key, nonce=nonce, stretch=quick)


def proof_of(ashore: Station, answer: bytes | None) -> bytes:
    proof = ashore.receive(answer or b"")
    assert proof is not None
    return proof


def changed(message: bytes, **fields: object) -> bytes:
    return bytes(msgpack.packb({**msgpack.unpackb(message), **fields}))


def test_both_sides_learn_each_others_key() -> None:
    aboard, ashore = board(made=stretch), Station(CODE, STATION_KEY, nonce=b"n" * 32)
    proof = proof_of(ashore, aboard.receive(ashore.hello, 1))
    assert aboard.receive(proof, 2) is None
    assert not ashore.proved
    key, last = aboard.accept(3)
    assert key == STATION_KEY
    assert ashore.receive(last) is None
    assert (ashore.proved, ashore.board_key, ashore.boat_id) == (True, BOARD_KEY, "springer")
    assert max(map(len, (ashore.hello, proof, last))) <= pairing.MAX_MESSAGE_BYTES


def test_the_proofs_are_what_the_page_says() -> None:
    """docs/security.md: another program must be able to pair."""
    import hashlib
    import hmac

    aboard, ashore = board(nonce=b"M" * 32, made=stretch), Station(CODE, STATION_KEY, nonce=b"n" * 32)
    answer = aboard.receive(ashore.hello, 1)
    assert answer is not None
    key = hashlib.scrypt(CODE.encode(), salt=b"n" * 32 + b"M" * 32, n=16384, r=8, p=1, dklen=32)
    told = b"".join(len(message).to_bytes(2, "big") + message for message in (ashore.hello, answer))
    shore, boat = (hmac.new(key, b"wayfix-pair-1 " + side + told, "sha256").digest() for side in (b"shore", b"boat"))
    assert ashore.receive(answer) == msgpack.packb({"proof": shore})
    assert msgpack.unpackb(ashore.hello) == {"version": 1, "nonce": b"n" * 32, "key": STATION_KEY}
    assert msgpack.unpackb(answer) == {"nonce": b"M" * 32, "key": BOARD_KEY, "boat_id": "springer"}
    aboard.receive(msgpack.packb({"proof": shore}), 2)
    assert aboard.accept(3)[1] == msgpack.packb({"proof": boat})


def test_a_wrong_code_burns_the_right_one() -> None:
    aboard, guesser = board(), station(OTHER_CODE)
    with pytest.raises(LinkError, match="a wrong code was given"):
        aboard.receive(proof_of(guesser, aboard.receive(guesser.hello, 1)), 2)
    with pytest.raises(LinkError, match="cannot be used: a wrong code"):
        aboard.accept(3)
    honest = station()
    with pytest.raises(LinkError, match="cannot be used: a wrong code"):
        aboard.receive(honest.hello, 3)


def test_an_exchange_cannot_be_replayed() -> None:
    """Even when chance gave the same code again: the nonces are new."""
    first, ashore = board(), station()
    proof = proof_of(ashore, first.receive(ashore.hello, 1))
    second = board(nonce=b"M" * 32)
    second.receive(ashore.hello, 1)
    with pytest.raises(LinkError, match="a wrong code"):
        second.receive(proof, 2)
    with pytest.raises(LinkError):
        second.accept(3)

    first.receive(proof, 2)
    _, last = first.accept(3)
    later = station(nonce=b"m" * 32)
    proof_of(later, changed(ashore.hello and (board().receive(later.hello, 1) or b"")))
    with pytest.raises(LinkError, match="does not know the code"):
        later.receive(last)
    assert later.board_key == b""


def test_a_proof_cannot_be_reflected() -> None:
    ashore = station()
    answer = bytes(msgpack.packb({"nonce": b"n" * 32, "key": STATION_KEY, "boat_id": "springer"}))
    proof = proof_of(ashore, answer)
    with pytest.raises(LinkError, match="does not know the code"):
        ashore.receive(proof)
    assert (ashore.board_key, ashore.boat_id) == (b"", "")
    with pytest.raises(LinkError):
        station().receive(station().hello)


@pytest.mark.parametrize("fields", [{"key": THIEF_KEY}, {"nonce": b"x" * 32}])
def test_a_man_in_the_middle_cannot_put_his_key_in_the_stations_place(fields: dict[str, bytes]) -> None:
    aboard, ashore = board(), station()
    answer = aboard.receive(changed(ashore.hello, **fields), 1)
    with pytest.raises(LinkError, match="a wrong code"):
        aboard.receive(proof_of(ashore, answer), 2)
    with pytest.raises(LinkError):
        aboard.accept(3)


@pytest.mark.parametrize("fields", [{"key": THIEF_KEY}, {"nonce": b"x" * 32}, {"boat_id": "another"}])
def test_a_man_in_the_middle_cannot_put_his_key_in_the_boards_place(fields: dict[str, object]) -> None:
    aboard, ashore = board(), station()
    answer = aboard.receive(ashore.hello, 1) or b""
    proof = proof_of(ashore, changed(answer, **fields))
    with pytest.raises(LinkError, match="a wrong code"):
        aboard.receive(proof, 2)
    with pytest.raises(LinkError):
        aboard.accept(3)
    for last in (proof, msgpack.packb({"proof": b"\0" * 32}), b""):
        copy = station()
        proof_of(copy, changed(answer, **fields))
        with pytest.raises(LinkError):
            copy.receive(last)
        assert copy.board_key == b""


@pytest.mark.parametrize("step", [0, 1, 2])
def test_after_two_minutes_the_code_is_worth_nothing(step: int) -> None:
    times = [NS_PER_S] * step + [120 * NS_PER_S] * (3 - step)
    aboard, ashore = board(), station()

    def play() -> None:
        proof = proof_of(ashore, aboard.receive(ashore.hello, times[0]))
        aboard.receive(proof, times[1])
        aboard.accept(times[2])

    with pytest.raises(LinkError, match="its 120 s are over"):
        play()
    with pytest.raises(LinkError):
        aboard.accept(0)


def test_one_exchange_only() -> None:
    aboard, ashore = board(), station()
    proof = proof_of(ashore, aboard.receive(ashore.hello, 1))
    aboard.receive(proof, 2)
    _, last = aboard.accept(3)
    for again in (lambda: aboard.accept(4), lambda: aboard.receive(ashore.hello, 4), lambda: aboard.receive(proof, 4)):
        with pytest.raises(LinkError, match="it was used"):
            again()
    ashore.receive(last)
    with pytest.raises(LinkError, match="over"):
        ashore.receive(last)


def test_no_acceptance_before_the_proof() -> None:
    aboard, ashore = board(), station()
    for _ in range(2):
        with pytest.raises(LinkError, match="nothing is proved"):
            aboard.accept(1)
    aboard.receive(ashore.hello, 1)
    with pytest.raises(LinkError, match="nothing is proved"):
        aboard.accept(1)
    aboard.burn("a second client came")
    with pytest.raises(LinkError, match="a second client came"):
        aboard.receive(proof_of(ashore, changed(board().receive(ashore.hello, 1) or b"")), 2)


def test_another_version_is_told() -> None:
    with pytest.raises(LinkError, match="pairs by version 2, we by 1"):
        board().receive(changed(station().hello, version=2), 1)


def test_a_boat_id_that_cannot_be_kept_is_refused() -> None:
    answer = board().receive(station().hello, 1) or b""
    for boat_id in ("", "a\nb", "x" * 65, "\x1b[2J"):
        with pytest.raises(LinkError, match="cannot be kept"):
            station().receive(changed(answer, boat_id=boat_id))


@given(bits=st.integers(0, 2**60 - 1), seed=st.randoms(use_true_random=False))
def test_a_code_is_read_as_people_type_it(bits: int, seed: random.Random) -> None:
    code = code_of(bits)
    assert len(code) == 14
    plain = code.replace("-", "")
    assert plain_code(code) == plain
    spelled = {"0": "0oO", "1": "1iIlL", "-": ["-", "", " ", "--"]}
    typed = "".join(seed.choice(spelled.get(letter, [letter, letter.lower()])) for letter in code)
    assert plain_code(f" {typed}\n") == plain


@given(text=st.text(max_size=20))
def test_any_text_is_a_code_or_refused(text: str) -> None:
    try:
        code = plain_code(text)
    except WayfixError:
        return
    assert len(code) == 12
    assert set(code) <= set(CROCKFORD)


def test_codes_are_all_different() -> None:
    assert len({code_of(1 << place) for place in range(60)}) == 60
    assert {len(code_of(2**60 - 1 - number)) for number in range(1000)} == {14}


def test_lengths_on_the_wire() -> None:
    assert length_of(framed(b"x" * 1024)[:2]) == 1024
    for prefix in (b"\0\0", b"\x04\x01", b"\xff\xff", b"GE"):
        with pytest.raises(LinkError):
            length_of(prefix)


def mutated(message: bytes, chance: random.Random) -> bytes:
    """Random bytes, or this message with bytes changed, cut, doubled, put in."""
    kind = chance.randrange(6)
    if kind == 0:
        return chance.randbytes(chance.randrange(1100))
    data = bytearray(message)
    if kind == 1:
        return bytes(data[: chance.randrange(len(data) + 1)])
    if kind == 2:
        return bytes(data + data[chance.randrange(len(data)) :])
    if kind == 3:
        return bytes(
            msgpack.packb(
                {
                    name: chance.choice([None, True, 2**63, -1.5, "x", b"x" * 32, [[]] * 3])
                    for name in msgpack.unpackb(message)
                }
            )
        )
    for _ in range(chance.randrange(1, 5)):
        data[chance.randrange(len(data))] = chance.randrange(256)
    return bytes(data)


def attack(count: int, seed: int) -> None:
    """Half-way exchanges with `count` bad messages: each ends in LinkError or in nothing, and no key comes out."""
    chance = random.Random(seed)
    honest, ashore = board(), station()
    answer = honest.receive(ashore.hello, 1) or b""
    proof = proof_of(ashore, answer)
    honest.receive(proof, 1)
    last = honest.accept(1)[1]
    for _ in range(count // 2):  # one at least to each side
        aboard, fresh = board(), station()
        bad = mutated(ashore.hello, chance)
        with_key = None
        try:
            aboard.receive(bad, 1)
            aboard.receive(mutated(proof, chance), 1)
            with_key = aboard.accept(1)
        except LinkError:
            pass
        assert with_key is None or bad == ashore.hello
        try:
            fresh.receive(mutated(answer, chance))
            fresh.receive(mutated(last, chance))
        except LinkError:
            pass
        assert not fresh.proved or fresh.board_key == BOARD_KEY


def test_random_and_mutated_messages() -> None:
    attack(4_000, seed=1)


@pytest.mark.slow
def test_a_hundred_thousand_random_and_mutated_messages_leave_no_trace() -> None:
    attack(4_000, seed=2)
    tracemalloc.start()
    try:
        msgpack.packb(0)
        before, packing = tracemalloc.get_traced_memory()  # its buffer for each message packed: 1 MiB of msgpack 1.0.3
        attack(100_000, seed=3)
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 100_000
    assert peak - before < 100_000 + packing


@given(
    steps=st.lists(
        st.tuples(st.sampled_from(["hello", "proof", "wrong", "junk", "accept", "burn"]), st.integers(0, 130)),
        max_size=8,
    )
)
def test_a_key_comes_out_of_the_right_order_only(steps: list[tuple[str, int]]) -> None:
    """Model: hello, proof, accept, in time, nothing else before or between."""
    aboard, ashore = board(), station()
    answer = changed(board().receive(ashore.hello, 0) or b"")
    proof, wrong = proof_of(ashore, answer), proof_of(station(OTHER_CODE), answer)
    good: list[str] = []
    alive = True
    for what, t_s in steps:
        now_ns = t_s * NS_PER_S
        came_out = None
        try:
            if what == "accept":
                came_out = aboard.accept(now_ns)
            elif what == "burn":
                aboard.burn("somebody wished it")
            else:
                sent = {"hello": ashore.hello, "proof": proof, "wrong": wrong, "junk": b"?"}[what]
                aboard.receive(sent, now_ns)
            fine = True
        except LinkError:
            fine = False
        alive = alive and t_s < 120
        expected = alive and [*good, what] in (["hello"], ["hello", "proof"], ["hello", "proof", "accept"])
        assert fine is (expected or what == "burn")
        assert (came_out is not None) is (expected and what == "accept")
        if expected:
            good.append(what)
        if what == "burn" or (not expected and what != "accept"):
            alive = False
        if came_out is not None:
            alive = False
