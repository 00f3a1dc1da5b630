<!DOCTYPE PickedPoints>
<PickedPoints>
 <point x="1.5" y="2" z="-3e1" active="1" name="a"/>
 <point x="0" y="0" z="0" active="0" name="b"/>
</PickedPoints>
