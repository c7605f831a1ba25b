-- A synchronous FIFO of 16384 bytes in place of the vendor's: what it gives is on q one clock after rdreq, sclr empties it.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity FrameBufferFIFO is
  port (
    clock : in  std_logic;
    data  : in  std_logic_vector(7 downto 0);
    rdreq : in  std_logic;
    sclr  : in  std_logic;
    wrreq : in  std_logic;
    empty : out std_logic;
    full  : out std_logic;
    q     : out std_logic_vector(7 downto 0) := (others => '0');
    usedw : out std_logic_vector(13 downto 0) := (others => '0'));
end FrameBufferFIFO;

architecture model of FrameBufferFIFO is
  type memory_t is array (0 to 16383) of std_logic_vector(7 downto 0);
  signal held : natural range 0 to 16384 := 0;
begin
  usedw <= std_logic_vector(to_unsigned(held mod 16384, 14));
  empty <= '1' when held = 0 else '0';
  full  <= '1' when held = 16384 else '0';

  process (clock)
    variable memory : memory_t;
    variable head, count : natural := 0;
  begin
    if rising_edge(clock) then
      if sclr = '1' then
        count := 0;
      else
        if rdreq = '1' and held > 0 then
          q <= memory(head);
          head := (head + 1) mod 16384;
          count := count - 1;
        end if;
        if wrreq = '1' and held < 16384 then
          memory((head + count) mod 16384) := data;
          count := count + 1;
        end if;
      end if;
      held <= count;
    end if;
  end process;
end model;
